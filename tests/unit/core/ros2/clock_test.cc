// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/clock.h"

#include <gtest/gtest.h>

#include <optional>

#include "core/ros2/participant.h"
#include "core/util/wall_clock.h"
#include "tests/support/log.h"
#include "tests/support/options.h"
#include "tests/support/ros2_time.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

class Ros2Clocks : public ::testing::Test {
 protected:
  void say(double time) {
    player_->publish("/clock", ros2_clock(time));
    clock_.poll(start_);
  }

  MiddlewareOptions options_ = middleware_options("inprocess", 78);
  Ros2Participant node_{options_, "node", nullptr};
  std::optional<Ros2Participant> player_{std::in_place, options_, "player", nullptr};
  const Clock::time_point start_ = Clock::now();
  Ros2Clock clock_;
};

TEST_F(Ros2Clocks, AreThisHostsWhereNothingElseIsSaid) {
  const std::uint64_t before = nanoseconds_since_epoch();
  clock_.poll(start_ + seconds(60));
  EXPECT_TRUE(clock_.known());
  EXPECT_GE(clock_.time(), before);
  EXPECT_EQ(clock_.at(start_), start_);
  EXPECT_EQ(clock_.trouble(), "");
}

TEST_F(Ros2Clocks, FollowWhatComesAndStandStillWithIt) {
  const Log log;
  clock_.follow(node_.subscribe<rosgraph_msgs::msg::dds_::Clock_>("/clock"));
  EXPECT_FALSE(clock_.known());
  EXPECT_EQ(clock_.time(), 0u);
  say(10.25);
  EXPECT_TRUE(clock_.known());
  EXPECT_EQ(clock_.time(), 10'250'000'000u);
  const Clock::time_point first = clock_.at(start_);
  say(12.75);
  EXPECT_EQ(clock_.at(start_) - first, milliseconds(2500));
  EXPECT_EQ(clock_.at(start_ + seconds(3600)) - first, milliseconds(2500)) << "it is paused";
  clock_.poll(start_ + seconds(3600));
  EXPECT_EQ(clock_.trouble(), "");
  EXPECT_EQ(log.text(), "");
}

TEST_F(Ros2Clocks, GoOnFromWhereTheyAreSetBack) {
  const Log log;
  clock_.follow(node_.subscribe<rosgraph_msgs::msg::dds_::Clock_>("/clock"));
  say(10);
  const Clock::time_point first = clock_.at(start_);
  for (const double time : {12, 11, 13, 1, 1}) say(time);
  EXPECT_EQ(clock_.at(start_) - first, seconds(2 + 2));
  EXPECT_EQ(clock_.time(), 1'000'000'000u);
  EXPECT_EQ(clock_.setbacks(), 2);
  EXPECT_EQ(occurrences(log.text(), "\n"), 1) << log.text();
  EXPECT_TRUE(log.has("/clock was set back by 1.0 s, and ages begin anew")) << log.text();
}

TEST_F(Ros2Clocks, SayWhoShouldPublishThem) {
  const Log log;
  clock_.follow(node_.subscribe<rosgraph_msgs::msg::dds_::Clock_>("/clock"));
  const Clock::time_point followed = Clock::now();
  clock_.poll(followed + seconds(4));
  EXPECT_EQ(clock_.trouble(), "");
  for (const int later : {6, 7}) clock_.poll(followed + seconds(later));
  const std::string nobody = "nobody publishes rosgraph_msgs/msg/Clock on /clock";
  EXPECT_EQ(clock_.trouble(), nobody);
  EXPECT_EQ(occurrences(log.text(), "--use-sim-time: " + nobody + ": time stands still until a simulator"), 1)
      << log.text();
  say(5);
  EXPECT_EQ(clock_.trouble(), "");
  player_.reset();
  clock_.poll(followed + seconds(20));
  EXPECT_EQ(clock_.trouble(), nobody) << "its publisher has left";
  EXPECT_EQ(clock_.time(), 5'000'000'000u);
}

TEST_F(Ros2Clocks, AreThoseOfTheParticipantWithUseSimTime) {
  Ros2Options simulated = options_;
  simulated.use_sim_time = true;
  Ros2Participant node(simulated, "simulated", nullptr);
  say(7);
  node.poll();
  EXPECT_EQ(node.clock().time(), 7'000'000'000u);
  EXPECT_EQ(node.now(), node.now());
}

}  // namespace
}  // namespace citylearn::testing
