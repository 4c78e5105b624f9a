// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/graph.h"

#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include "core/ros2/participant.h"
#include "ros2/ros2.h"
#include "tests/support/options.h"

namespace citylearn {
namespace {

using Lines = std::vector<std::string>;

std::string hex_of(const Bytes& bytes) {
  std::string text;
  for (const std::byte byte : bytes) text += fmt::format("{:02x}", std::to_integer<int>(byte));
  return text;
}

Ros2Node bridge() {
  Ros2Node node{{1, 0x10, 0x7e, 0x9c, 0x20, 0x6c, 0xa4, 0x59, 0xbe, 0x58, 0x59, 0x2d, 0, 0, 1, 0xc1},
                "/citylearn",
                "ros2_bridge",
                {},
                {}};
  node.writers = {node.participant};
  node.writers[0][14] = 2;
  node.writers[0][15] = 3;
  return node;
}

/// Returns the message of rmw_dds_common as worked out by hand, with so much behind each gid: encapsulation, the
/// participant, one node, its namespace (11 bytes, padded to 12), its name (12), no reader, one writer.
std::string by_hand(const std::string& more) {
  return "0001000001107e9c206ca459be58592d000001c1" + more +
         "010000000b0000002f636974796c6561726e00000c000000726f73325f627269646765000000000001000000"
         "01107e9c206ca459be58592d00000203" +
         more;
}

TEST(Ros2Nodes, AreBytesOfRmwDdsCommon) {
  EXPECT_EQ(hex_of(encode_ros2(bridge(), ros2_gid_bytes("jazzy"))), by_hand(""));
  EXPECT_EQ(hex_of(encode_ros2(bridge(), ros2_gid_bytes("humble"))), by_hand("0000000000000000"));
}

TEST(Ros2Nodes, TellTheirReleaseByTheSizeOfGids) {
  for (const auto& [mine, other] : {std::pair{16u, 24u}, {24u, 16u}}) {
    Bytes bytes = encode_ros2(bridge(), mine), nobody(4 + mine + 4);  // a participant that has no node
    nobody[1] = std::byte{1};
    for (const Bytes& message : {bytes, nobody}) {
      EXPECT_TRUE(has_gids_of(mine, message));
      EXPECT_FALSE(has_gids_of(other, message));
    }
    for (std::size_t at = 0; at < bytes.size(); ++at) {
      EXPECT_FALSE(has_gids_of(mine, std::span(bytes).first(at)));
      Bytes wrong = bytes;
      wrong[at] = std::byte{0xFF};
      has_gids_of(mine, wrong);  // a length among them would be of gigabytes
    }
  }
}

TEST(Ros2Nodes, SayOnceThatOthersDoNotSeeThem) {
  Ros2Options now = testing::middleware_options("inprocess", 77), before = now;
  before.distro = "humble";
  Ros2Participant iron(now, "iron", nullptr), humble(before, "humble", nullptr);
  EXPECT_EQ(iron.poll(), Lines());
  EXPECT_EQ(humble.poll(), Lines{"nodes of ROS 2 Iron or later are here: they see this node with --ros-distro jazzy"});
  EXPECT_EQ(iron.poll(),
            Lines{"nodes of ROS 2 Humble or before are here: they see this node with --ros-distro humble"});
  humble.advertise<std_msgs::msg::dds_::String_>("/a");
  EXPECT_EQ(humble.poll(), Lines());
  EXPECT_EQ(iron.poll(), Lines());
}

// As rosidl 4.9.2 computes them.
TEST(Ros2Types, HaveTheHashesOfRos2) {
  for (const auto& [name, hash] :
       {std::pair{"sensor_msgs/msg/Image", "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"},
        {"sensor_msgs/msg/NavSatFix", "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404"},
        {"nav_msgs/msg/Odometry", "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"},
        {"rosgraph_msgs/msg/Clock", "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564"}})
    EXPECT_EQ(ros2_type(name)->hash, hash);
}

}  // namespace
}  // namespace citylearn
