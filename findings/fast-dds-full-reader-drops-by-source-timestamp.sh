#!/usr/bin/env bash
# Fast DDS 2.9.1: DESTINATION_ORDER is BY_RECEPTION_TIMESTAMP by default, yet a KEEP_LAST reader that is full drops by
# the writers' clocks: the newest sample is lost when its writer's clock is behind. Needs g++, apt-get of Debian 12.
set -eu
T=$(mktemp -d); trap 'rm -rf "$T"' EXIT; chmod 755 "$T"; cd "$T"
apt-get download -q libfastrtps-dev=2.9.1+ds-1+deb12u2 libfastrtps2.9=2.9.1+ds-1+deb12u2 libfastcdr-dev=1.0.26-1 \
  libfastcdr1=1.0.26-1 libfoonathan-memory0.7.2 libtinyxml2-9 >download.log 2>&1
for package in *.deb; do dpkg -x "$package" .; done
cat >late.cc <<'END'
#include <cstdio>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
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
int main() {
  auto* all = DomainParticipantFactory::get_instance()->create_participant(138, PARTICIPANT_QOS_DEFAULT);
  TypeSupport(new Letter).register_type(all);
  Topic* topic = all->create_topic("letters", "Letter", TOPIC_QOS_DEFAULT);
  DataReaderQos qos; qos.reliability().kind = RELIABLE_RELIABILITY_QOS; qos.history().depth = 2;
  DataReader* reader = all->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, qos);
  Publisher* out = all->create_publisher(PUBLISHER_QOS_DEFAULT);
  DataWriter *right = out->create_datawriter(topic, DATAWRITER_QOS_DEFAULT), *behind = out->create_datawriter(topic, DATAWRITER_QOS_DEFAULT);
  auto write = [](DataWriter* w, char c, int s) { w->write_w_timestamp(&c, InstanceHandle_t(), eprosima::fastrtps::Time_t(s, 0u)); };
  write(right, 'a', 3601); write(right, 'b', 3602); write(behind, 'c', 3);  // in this order; c is the newest
  SampleInfo info; char c; while (reader->take_next_sample(&c, &info) == ReturnCode_t::RETCODE_OK) putchar(c);
  fflush(stdout); _Exit(0); }
END
g++ -std=c++17 -Iusr/include late.cc -o late -Lusr/lib/x86_64-linux-gnu -l:libfastrtps.so.2.9 -l:libfastcdr.so.1 -Wl,--allow-shlib-undefined
kept=$(LD_LIBRARY_PATH=usr/lib/x86_64-linux-gnu unshare -rn ./late)  # within one process, without any network
echo "Fast DDS 2.9.1, a reader of depth 2 keeps '$kept' of a, b, c (by reception: 'bc')"; [ "$kept" = ab ]
