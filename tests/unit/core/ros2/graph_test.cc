// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/graph.h"

#include <gtest/gtest.h>

#include <map>

#include "core/ros2/messages.h"

namespace citylearn {
namespace {

/// Returns bytes as hexadecimal digits.
std::string hex_of(const Bytes& bytes) {
  std::string text;
  for (const std::byte byte : bytes)
    for (const int digit : {static_cast<int>(byte) >> 4, static_cast<int>(byte) & 15})
      text += "0123456789abcdef"[digit];
  return text;
}

Ros2Node bridge() {
  Ros2Node node{{0x01, 0x10, 0x7e, 0x9c, 0x20, 0x6c, 0xa4, 0x59, 0xbe, 0x58, 0x59, 0x2d, 0, 0, 0x01, 0xc1},
                "/citylearn",
                "ros2_bridge",
                {},
                {}};
  node.writers.push_back(node.participant);
  node.writers[0][14] = 0x02;
  node.writers[0][15] = 0x03;
  return node;
}

// As rmw_dds_common's ParticipantEntitiesInfo, worked out by hand: encapsulation, the participant's gid, one node, its
// namespace (11 bytes, padded), its name, no readers, one writer.
TEST(Ros2Nodes, AreBytesOfRmwDdsCommon) {
  EXPECT_EQ(hex_of(encode_ros2(bridge(), ros2_gid_bytes("jazzy"))),
            "00010000"
            "01107e9c206ca459be58592d000001c1"
            "01000000"
            "0b000000"
            "2f636974796c6561726e0000"
            "0c000000"
            "726f73325f62726964676500"
            "00000000"
            "01000000"
            "01107e9c206ca459be58592d00000203");
}

TEST(Ros2Nodes, HaveLongerGidsUpToHumble) {
  EXPECT_EQ(hex_of(encode_ros2(bridge(), ros2_gid_bytes("humble"))),
            "00010000"
            "01107e9c206ca459be58592d000001c1"
            "0000000000000000"
            "01000000"
            "0b000000"
            "2f636974796c6561726e0000"
            "0c000000"
            "726f73325f62726964676500"
            "00000000"
            "01000000"
            "01107e9c206ca459be58592d00000203"
            "0000000000000000");
  std::map<std::size_t, int> counts;
  for (const std::string& distro : ros2_distros()) ++counts[ros2_gid_bytes(distro)];
  EXPECT_EQ(counts, (std::map<std::size_t, int>{{24, 3}, {16, 5}}));
}

// As rosidl 4.9.2 computes them.
TEST(Ros2Types, HaveTheHashesOfRos2) {
  const std::map<std::string, std::string> hashes = {
      {"sensor_msgs/msg/CompressedImage", "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"},
      {"sensor_msgs/msg/Image", "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"},
      {"sensor_msgs/msg/NavSatFix", "62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404"},
      {"geometry_msgs/msg/PoseStamped", "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"},
      {"geometry_msgs/msg/Twist", "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"},
      {"nav_msgs/msg/Odometry", "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"},
      {"std_msgs/msg/String", "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"},
      {"std_msgs/msg/Float32", "7170d3d8f841f7be3172ce5f4f59f3a4d7f63b0447e8b33327601ad64d83d6e2"},
      {"std_msgs/msg/Float64", "705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a"},
      {"std_msgs/msg/UInt8", "6138bd83d8c3569cb80a667db03cfc1629f529fee79d944c39c34e352e72f010"}};
  for (const auto& [name, hash] : hashes) EXPECT_EQ(ros2_type(name)->hash, "RIHS01_" + hash) << name;
}

}  // namespace
}  // namespace citylearn
