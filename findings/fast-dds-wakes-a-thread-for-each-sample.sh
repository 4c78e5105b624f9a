#!/usr/bin/env bash
# Fast DDS 2.9.1: with its defaults a reliable writer wakes one more thread of its process for each sample, only to end
# a time of 0 s in which a reader's request for that sample is ignored (nackSupressionDuration). A time of 2.5 ms costs
# less: its thread sleeps over many samples. Needs g++, apt-get of Debian 12.
set -eu
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT; chmod 755 "$T"; cd "$T"
apt-get download -q libfastrtps-dev=2.9.1+ds-1+deb12u2 libfastrtps2.9=2.9.1+ds-1+deb12u2 libfastcdr-dev=1.0.26-1 \
  libfastcdr1=1.0.26-1 libfoonathan-memory0.7.2 libtinyxml2-9 >download.log 2>&1
for package in *.deb; do dpkg -x "$package" .; done
cat >wake.cc <<'END'
#include <sys/resource.h>
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
#include <fastrtps/xmlparser/XMLProfileManager.h>
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
int main(int, char** argv) {
  eprosima::fastrtps::LibrarySettingsAttributes settings; settings.intraprocess_delivery = eprosima::fastrtps::INTRAPROCESS_OFF;
  eprosima::fastrtps::xmlparser::XMLProfileManager::library_settings(settings);  // as if the two were two processes
  DomainParticipantQos network; network.transport().use_builtin_transports = false;
  network.transport().user_transports.push_back(std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>());
  TypeSupport type(new Letter); DomainParticipant* all[2]; Topic* topics[2];
  for (int i = 0; i < 2; ++i) {
    all[i] = DomainParticipantFactory::get_instance()->create_participant(138, network);
    type.register_type(all[i]); topics[i] = all[i]->create_topic("letters", "Letter", TOPIC_QOS_DEFAULT); }
  DataReaderQos reading; reading.reliability().kind = RELIABLE_RELIABILITY_QOS;
  DataReader* reader = all[1]->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topics[1], reading);
  DataWriterQos writing;  // reliable
  writing.reliable_writer_qos().times.nackSupressionDuration = Duration_t(0, (uint32_t)atoi(argv[1]));
  DataWriter* writer = all[0]->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topics[0], writing);
  PublicationMatchedStatus matched; do writer->get_publication_matched_status(matched); while (!matched.current_count);
  SampleInfo info; char c = 'a'; rusage before, after; constexpr int n = 4000;
  for (int i = 0; i <= n; ++i) {
    if (i == 1) getrusage(RUSAGE_SELF, &before);
    writer->write(&c); while (reader->take_next_sample(&c, &info) != ReturnCode_t::RETCODE_OK) ; }
  getrusage(RUSAGE_SELF, &after);
  printf("%.2f\n", double(after.ru_nvcsw - before.ru_nvcsw) / n); fflush(stdout); _Exit(0); }
END
g++ -std=c++17 -O2 -Iusr/include wake.cc -o wake -Lusr/lib/x86_64-linux-gnu -l:libfastrtps.so.2.9 -l:libfastcdr.so.1 \
  -Wl,--allow-shlib-undefined
run() { LD_LIBRARY_PATH=usr/lib/x86_64-linux-gnu unshare -rn sh -c "ip link set lo up; exec ./wake $1"; }
default=$(run 0) longer=$(run 2500000)
echo "Fast DDS 2.9.1, voluntary context switches a sample: $default with 0 s (the default), $longer with 2.5 ms"
awk "BEGIN{exit !($default > $longer + .7)}"
