#!/usr/bin/env bash
# Fast DDS 2.9.1 does not learn that a reader of Cyclone DDS 0.10.2 was deleted while its participant lives on: the
# reader stays matched. What Cyclone DDS announces about an endpoint that is gone has no key hash, which RTPS leaves to
# the sender. With key hashes (GenerateKeyhash, off by default) Fast DDS sees it at once.
# Seen: "1 1" without and "1 0" with them, matched readers before and up to 5 s after the reader was deleted.
# Needs g++, apt-get of Debian 12, unshare and ip.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; chmod 755 "$folder"; cd "$folder"
apt-get download -qq {libfastrtps-dev,libfastrtps2.9}=2.9.1+ds-1+deb12u2 {libfastcdr-dev,libfastcdr1}=1.0.26-1 \
  {cyclonedds-dev,libddsc0debian}=0.10.2-2 libfoonathan-memory0.7.2 libtinyxml2-9 libiceoryx-{binding-c,hoofs,platform,posh}2 2>/dev/null
for package in ./*.deb; do dpkg -x "$package" .; done
cat >deleted.cc <<'END'
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastrtps/types/DynamicPubSubType.h>
#include <fastrtps/types/DynamicTypeBuilder.h>
#include <fastrtps/types/DynamicTypeBuilderFactory.h>
#include <unistd.h>
#include <cstdio>
#undef PID_PAD
#include <dds/dds.h>
using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::types;
int main(int, char** arguments) {
  auto* types = DynamicTypeBuilderFactory::get_instance();
  auto* letter = types->create_struct_builder();
  letter->set_name("Letter");
  letter->add_member(0, "octet", types->create_byte_type());
  auto* fast = DomainParticipantFactory::get_instance()->create_participant(0, PARTICIPANT_QOS_DEFAULT);
  TypeSupport type_of_fast(new DynamicPubSubType(letter->build()));
  type_of_fast->auto_fill_type_information(false);  // Cyclone DDS refuses what Fast DDS sends
  type_of_fast.register_type(fast);
  Topic* letters = fast->create_topic("letters", "Letter", TOPIC_QOS_DEFAULT);
  DataWriter* writer = fast->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(letters, DATAWRITER_QOS_DEFAULT);
  auto matched = [&] { PublicationMatchedStatus now; writer->get_publication_matched_status(now); return now.current_count; };
  dds_create_domain(0, arguments[1]);
  const dds_entity_t cyclone = dds_create_participant(0, nullptr, nullptr);
  const uint32_t octet[] = {DDS_OP_ADR | DDS_OP_TYPE_1BY, 0, DDS_OP_RTS};
  const dds_topic_descriptor_t type = {1, 1, DDS_TOPIC_FIXED_SIZE, 0, "Letter", nullptr, 2, octet, ""};
  const dds_entity_t topic = dds_create_topic(cyclone, &type, "letters", nullptr, nullptr);
  const dds_entity_t reader = dds_create_reader(cyclone, topic, nullptr, nullptr);
  for (int i = 0; i < 200 && matched() == 0; ++i) usleep(100'000);
  std::printf("%d ", matched());
  dds_delete(reader);
  for (int i = 0; i < 50 && matched() > 0; ++i) usleep(100'000);
  std::printf("%d\n", matched());
  std::fflush(stdout), _Exit(0);
}
END
lib=$(echo usr/lib/*-linux-gnu)
g++ -std=c++17 -w -Iusr/include deleted.cc -o deleted "$lib"/lib{fastrtps.so.2.9,fastcdr.so.1,ddsc.so.0debian} -Wl,--allow-shlib-undefined
seen=$(LD_LIBRARY_PATH=$lib unshare -rn sh <<'END'
ip link set lo up
lo='<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces></General>'
./deleted "$lo"
./deleted "$lo<Internal><GenerateKeyhash>true</GenerateKeyhash></Internal>"
END
)
echo "Matched for Fast DDS 2.9.1 before and after Cyclone DDS 0.10.2 deleted its reader, without and with key hashes:"
echo "$seen"; [ "$seen" = "$(printf '1 1\n1 0')" ]
