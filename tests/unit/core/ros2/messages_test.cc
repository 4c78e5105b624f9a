// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/messages.h"

#include <gtest/gtest.h>

#include "core/ros2/participant.h"
#include "core/util/error.h"
#include "ros2/ros2.h"

namespace citylearn {
namespace {

using Picture = sensor_msgs::msg::dds_::CompressedImage_;
using Odometry = nav_msgs::msg::dds_::Odometry_;

Picture picture() {
  Picture message;
  message.header().stamp().sec(-7);
  message.header().stamp().nanosec(9);
  message.header().frame_id("camera");
  message.format("jpeg");
  message.data({1, 2, 3});
  return message;
}

TEST(Ros2Messages, WhatIsWrittenIsRead) {
  Bytes bytes;
  encode_ros2(picture(), bytes);
  Picture read;
  ASSERT_TRUE(decode_ros2(bytes, read));
  EXPECT_EQ(read, picture());
  Odometry odometry;
  odometry.child_frame_id("base");
  odometry.pose().pose().position().y(-2.5);
  odometry.twist().covariance()[35] = 4;
  encode_ros2(odometry, bytes);
  Odometry again;
  ASSERT_TRUE(decode_ros2(bytes, again));
  EXPECT_EQ(again, odometry);
}

TEST(Ros2Messages, SequencesOfMessagesGrowWithWhatIsThere) {
  nav_msgs::srv::dds_::GetPlan_Response_ plan, read;
  for (const char* frame : {"a", "map"}) plan.plan().poses().emplace_back().header().frame_id(frame);
  Bytes bytes;
  encode_ros2(plan, bytes);
  EXPECT_EQ(bytes.size(), 4u + 20 + (8 + 6 + 6 + 56) + (8 + 8 + 56)) << "6: before numbers of 8 bytes";
  ASSERT_TRUE(decode_ros2(bytes, read));
  EXPECT_EQ(read, plan);
  bytes[4 + 16] = std::byte{100};  // the length: as many bytes would be there, but not as many poses
  EXPECT_FALSE(decode_ros2(bytes, read));
  EXPECT_LE(read.plan().poses().size(), 3u);
}

TEST(Ros2Messages, ACutMessageIsRefusedWithoutAllocatingWhatItClaims) {
  Bytes bytes;
  encode_ros2(picture(), bytes);
  Picture read;
  for (std::size_t size = 0; size < bytes.size(); ++size)
    EXPECT_FALSE(decode_ros2(std::span(bytes).first(size), read)) << size;
  for (std::size_t at = 4; at < bytes.size(); ++at) {
    Bytes wrong = bytes;
    wrong[at] = std::byte{0xFF};
    decode_ros2(wrong, read);  // a length among them would be of gigabytes
    EXPECT_LE(read.data().capacity(), 1000u);
  }
  bytes[1] = std::byte{2};
  EXPECT_FALSE(decode_ros2(bytes, read)) << "a parameter list";
}

TEST(Ros2Topics, HaveOneName) {
  for (const char* name : {"/camera/image_raw", "camera/image_raw", "rt/camera/image_raw"})
    EXPECT_EQ(ros2_topic(name, ""), "/camera/image_raw");
  for (const char* name : {"", "/", "/a//b", "/a/", "/2a", "/a b", "rt/"})
    EXPECT_THROW(ros2_topic(name, "--camera"), Error) << name;
}

}  // namespace
}  // namespace citylearn
