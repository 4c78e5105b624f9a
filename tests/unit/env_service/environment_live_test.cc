// SPDX-License-Identifier: Apache-2.0
// An environment whose agent is a robot.
#include <gtest/gtest.h>

#include "env_service/environment.h"
#include "tests/support/env/env.h"

namespace citylearn::testing {
namespace {

class LiveEnvironment : public ::testing::Test {
 protected:
  LiveEnvironment() { traversal_.dimension = 0; }
  void see(int place, int frame) { environment_.sight({place, frame}); }
  void step(std::uint8_t action) { environment_.step(std::span(&action, 1)); }
  const msg::Observation& observe() {
    environment_.observe(seen_);
    return seen_;
  }

  Traversal traversal_ = small_traversal(20);
  Environment environment_{traversal_, 1};
  msg::Observation seen_;
};

TEST_F(LiveEnvironment, EpisodesBeginWhereTheRobotIs) {
  see(7, 20);
  for (const msg::Mode mode : {msg::TRAIN, msg::EVALUATE}) {
    environment_.reset(settings(mode, 20, 100));
    EXPECT_EQ(observe().position()[0], 7u);
    EXPECT_EQ(observe().frame()[0], 20u) << "what its camera took";
    EXPECT_NE(observe().goal()[0], 7u);
    EXPECT_EQ(observe().flags()[0], msg::FLAG_FIRST);
  }
}

TEST_F(LiveEnvironment, StepsLeadWhereTheRobotCame) {
  see(7, 20);
  environment_.reset(settings(msg::TRAIN, 20, 100));
  const int goal = static_cast<int>(observe().goal()[0]), onward = goal > 7 ? 1 : -1;
  const std::uint8_t action = goal > 7 ? kNext : kPrevious;
  EXPECT_EQ(environment_.way(0, action), std::pair(7, 7 + onward));
  EXPECT_EQ(environment_.way(0, kStay), std::pair(7, 7));
  see(7, 21);  // the wheels slipped
  step(action);
  EXPECT_EQ(observe().position()[0], 7u);
  EXPECT_EQ(observe().frame()[0], 21u);
  EXPECT_EQ(observe().reward()[0], -0.01f) << "no nearer";
  see(goal, 22);
  step(action);
  ASSERT_EQ(environment_.finished().size(), 1u);
  EXPECT_TRUE(environment_.finished()[0].completed);
  EXPECT_TRUE(environment_.finished()[0].path.empty()) << "its actions do not say where it went";
  EXPECT_EQ(observe().position()[0], static_cast<std::uint32_t>(goal)) << "the next episode begins there";
}

TEST_F(LiveEnvironment, ARobotBesideTheRouteIsAtItsNearestEnd) {
  msg::TaskSettings part = settings(msg::TRAIN, 5, 100);
  part.first_frame() = 10;
  for (const auto& [place, expected] : {std::pair(3, 10u), {12, 12u}, {19, 14u}}) {
    see(place, 20);
    environment_.reset(part);
    EXPECT_EQ(observe().position()[0], expected);
    EXPECT_EQ(observe().frame()[0], 20u);
  }
}

TEST_F(LiveEnvironment, AForbiddenActionIsRefusedBeforeTheRobotDrives) {
  see(0, 20);
  environment_.reset(settings(msg::TRAIN, 20, 100));
  const std::uint8_t back = kPrevious;
  EXPECT_THROW(environment_.check(std::span(&back, 1)), Error);
}

}  // namespace
}  // namespace citylearn::testing
