#!/usr/bin/env bash
# Fast DDS 2.9.1: initialAcknackDelay of a reader is no delay but a period, in which it asks a writer for what that has
# until its first heartbeat. With 0 s a reader asks a writer whose process was killed thousands of times a second, until
# the lease ends. 10 ms ask it 100 times. Needs g++, apt-get of Debian 12.
set -eu
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT; chmod 755 "$T"; cd "$T"
apt-get download -q libfastrtps-dev=2.9.1+ds-1+deb12u2 libfastrtps2.9=2.9.1+ds-1+deb12u2 libfastcdr-dev=1.0.26-1 \
  libfastcdr1=1.0.26-1 libfoonathan-memory0.7.2 libtinyxml2-9 >download.log 2>&1
for package in *.deb; do dpkg -x "$package" .; done
cat >ask.cc <<'END'
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::rtps;
struct Letter : TopicDataType {
  Letter() { setName("Letter"); m_typeSize = 8; }
  bool serialize(void* d, SerializedPayload_t* p) override { memset(p->data, *(char*)d, p->length = 8); return true; }
  bool deserialize(SerializedPayload_t* p, void* d) override { *(char*)d = p->data[4]; return true; }
  std::function<uint32_t()> getSerializedSizeProvider(void*) override { return [] { return 8u; }; }
  void* createData() override { return new char; }
  void deleteData(void* d) override { delete (char*)d; }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; } };
long sent() {  // datagrams of this network, so far
  FILE* file = fopen("/proc/net/snmp", "r"); char line[512]; long in, none, errors, out = 0;
  while (fgets(line, sizeof line, file)) if (sscanf(line, "Udp: %ld %ld %ld %ld", &in, &none, &errors, &out) == 4) break;
  fclose(file); return out; }
int main(int, char** argv) {
  const pid_t writer = fork();  // a process with a writer, which will be killed
  DomainParticipantQos network; network.transport().use_builtin_transports = false;
  network.transport().user_transports.push_back(std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>());
  TypeSupport type(new Letter); auto* all = DomainParticipantFactory::get_instance()->create_participant(138, network);
  type.register_type(all); Topic* topic = all->create_topic("letters", "Letter", TOPIC_QOS_DEFAULT);
  if (writer == 0) { all->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, DATAWRITER_QOS_DEFAULT); for (;;) pause(); }
  DataReaderQos reading; reading.reliability().kind = RELIABLE_RELIABILITY_QOS;
  Subscriber* in = all->create_subscriber(SUBSCRIBER_QOS_DEFAULT); SubscriptionMatchedStatus matched;
  DataReader* first = in->create_datareader(topic, reading);
  do first->get_subscription_matched_status(matched); while (!matched.current_count);
  kill(writer, SIGKILL); waitpid(writer, nullptr, 0);
  reading.reliable_reader_qos().times.initialAcknackDelay = Duration_t(0, (uint32_t)atoi(argv[1]));
  DataReader* second = in->create_datareader(topic, reading);
  do second->get_subscription_matched_status(matched); while (!matched.current_count);
  const long before = sent(); usleep(2000000); printf("%ld\n", (sent() - before) / 2); fflush(stdout); _Exit(0); }
END
g++ -std=c++17 -O2 -Iusr/include ask.cc -o ask -Lusr/lib/x86_64-linux-gnu -l:libfastrtps.so.2.9 -l:libfastcdr.so.1 \
  -Wl,--allow-shlib-undefined
run() { LD_LIBRARY_PATH=usr/lib/x86_64-linux-gnu unshare -rn sh -c "ip link set lo up; exec ./ask $1"; }
none=$(run 0) ten=$(run 10000000)
echo "Fast DDS 2.9.1, datagrams a second to a writer that was killed: $none with 0 s, $ten with 10 ms"
[ "$none" -gt 1000 ] && [ "$ten" -lt 200 ]
