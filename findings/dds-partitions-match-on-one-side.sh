#!/usr/bin/env bash
# A reader in partition "*" hears writers of every partition, one would think, the default one too. Fast DDS 2.9.1 and
# Cyclone DDS 0.10.2 (Debian 12) judge each by itself: Cyclone DDS matches "*" with the default partition, Fast DDS does
# not; Fast DDS matches two equal patterns, and sets as in "robot[1-3]", Cyclone DDS does not. When both meet, one side
# then says that it is matched, the other knows nothing of it, and not a sample arrives. Fast DDS has changed its rule
# for the default partition in September 2025; Debian 12's has not.
# It hurts those who record all partitions of peers of both vendors, and programs that wait for a match to start.
# Seen, "writer matched, reader matched, samples" of a Fast DDS writer and a Cyclone DDS reader: default to "*" 0 1 0,
# "*" to "*" 1 0 0, "robot2" to "robot[1-3]" 1 0 0, "robot2" to "*" and to "robot?" 1 1 1.
# Needs g++, apt-get of Debian 12, unshare and ip.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; chmod 755 "$folder"; cd "$folder"
apt-get download -qq {libfastrtps-dev,libfastrtps2.9}=2.9.1+ds-1+deb12u2 {libfastcdr-dev,libfastcdr1}=1.0.26-1 \
  {cyclonedds-dev,libddsc0debian}=0.10.2-2 libfoonathan-memory0.7.2 libtinyxml2-9 libiceoryx-{binding-c,hoofs,platform,posh}2 2>/dev/null
for package in ./*.deb; do dpkg -x "$package" .; done
cat >partitions.cc <<'END'
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastrtps/types/DynamicDataFactory.h>
#include <fastrtps/types/DynamicPubSubType.h>
#include <fastrtps/types/DynamicTypeBuilder.h>
#include <fastrtps/types/DynamicTypeBuilderFactory.h>
#include <unistd.h>
#include <cstdio>
#undef PID_PAD
#include <dds/dds.h>
using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::types;
int main(int, char** arguments) {  // the settings of Cyclone DDS, the writer's partition, the reader's
  auto* types = DynamicTypeBuilderFactory::get_instance();
  auto* letter = types->create_struct_builder();
  letter->set_name("Letter");
  letter->add_member(0, "octet", types->create_byte_type());
  const auto letter_type = letter->build();
  auto* fast = DomainParticipantFactory::get_instance()->create_participant(0, PARTICIPANT_QOS_DEFAULT);
  TypeSupport type_of_fast(new DynamicPubSubType(letter_type));
  type_of_fast->auto_fill_type_information(false);  // Cyclone DDS refuses what Fast DDS sends
  type_of_fast.register_type(fast);
  dds_create_domain(0, arguments[1]);
  const dds_entity_t cyclone = dds_create_participant(0, nullptr, nullptr);
  const uint32_t octet[] = {DDS_OP_ADR | DDS_OP_TYPE_1BY, 0, DDS_OP_RTS};
  const dds_topic_descriptor_t type = {1, 1, DDS_TOPIC_FIXED_SIZE, 0, "Letter", nullptr, 2, octet, ""};
  PublisherQos partition;
  if (*arguments[2]) partition.partition().push_back(arguments[2]);
  Topic* letters = fast->create_topic("letters", "Letter", TOPIC_QOS_DEFAULT);
  DataWriter* writer = fast->create_publisher(partition)->create_datawriter(letters, DATAWRITER_QOS_DEFAULT);
  dds_qos_t* qos = dds_create_qos();
  dds_qset_partition1(qos, arguments[3]);
  const dds_entity_t topic = dds_create_topic(cyclone, &type, "letters", nullptr, nullptr);
  const dds_entity_t reader = dds_create_reader(dds_create_subscriber(cyclone, qos, nullptr), topic, nullptr, nullptr);
  PublicationMatchedStatus of_writer;
  dds_subscription_matched_status_t of_reader{};
  for (int i = 0; i < 150 && of_writer.current_count + of_reader.current_count < 2; ++i) {
    usleep(100'000);
    writer->get_publication_matched_status(of_writer);
    dds_get_subscription_matched_status(reader, &of_reader);
  }
  writer->write(DynamicDataFactory::get_instance()->create_data(letter_type));
  sleep(1);  // all of it, as a sample could come
  uint8_t octets[1];
  void* samples[] = {octets};
  dds_sample_info_t info;
  const int taken = dds_take(reader, samples, &info, 1, 1);
  std::printf("%d %d %d\n", of_writer.current_count, int(of_reader.current_count), taken);
  std::fflush(stdout), _Exit(0);
}
END
lib=$(echo usr/lib/*-linux-gnu)
g++ -std=c++17 -w -Iusr/include partitions.cc -o partitions "$lib"/lib{fastrtps.so.2.9,fastcdr.so.1,ddsc.so.0debian} -Wl,--allow-shlib-undefined
seen=$(LD_LIBRARY_PATH=$lib unshare -rn sh -e <<'END'
ip link set lo up
lo='<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces></General>'
./partitions "$lo" '' '*'
./partitions "$lo" '*' '*'
./partitions "$lo" robot2 'robot[1-3]'
./partitions "$lo" robot2 '*'
./partitions "$lo" robot2 'robot?'
END
)
echo 'Fast DDS 2.9.1 writes, Cyclone DDS 0.10.2 reads: default to *, * to *, robot2 to robot[1-3], to *, to robot?:'
echo "$seen"; [ "$seen" = "$(printf '0 1 0\n1 0 0\n1 0 0\n1 1 1\n1 1 1')" ]
