// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "core/task/path.h"
#include "core/task/reward.h"
#include "core/task/spl.h"

namespace citylearn {
namespace {

TEST(Spl, IsTheShortestPathOverThePathTaken) {
  EXPECT_EQ(spl_of(true, 3, 3), 1);
  EXPECT_EQ(spl_of(true, 3, 12), 0.25);
  EXPECT_EQ(spl_of(true, 3, 2), 1);  // never above 1
  EXPECT_EQ(spl_of(false, 3, 3), 0);
  EXPECT_EQ(spl_of(true, 0, 0), 1);
  EXPECT_EQ(spl_of(true, 0, 4), 0);
  EXPECT_EQ(excess_of(4, 6), 1.5);
  EXPECT_EQ(excess_of(0, 0), 1);
}

TEST(EpisodeReward, IsOneAtTheGoalAndTakesForStepsThatGainNothing) {
  EpisodeReward reward(2, 8);
  EXPECT_EQ(reward.step(3), -0.125f);  // away
  EXPECT_EQ(reward.step(2), -0.125f);  // and back: as near as it was
  EXPECT_EQ(reward.step(2), -0.125f);  // on the spot
  EXPECT_EQ(reward.step(1), 0);
  EXPECT_FALSE(reward.reached());
  EXPECT_EQ(reward.step(0), 1);
  EXPECT_TRUE(reward.reached());
  EXPECT_FALSE(reward.out_of_steps());
  for (int i = 0; i < 3; ++i) reward.step(1);
  EXPECT_TRUE(reward.out_of_steps());
}

TEST(EpisodeReward, StepsNearerThanEverAreFreeAfterLeapsToo) {
  EpisodeReward reward(10, 8);
  EXPECT_EQ(reward.step(8), 0);  // an action that slipped and was done twice
  EXPECT_EQ(reward.step(9), -0.125f);
  EXPECT_EQ(reward.step(8), -0.125f);  // it was there
  reward.displace(3);
  EXPECT_EQ(reward.step(4), -0.125f);
  EXPECT_EQ(reward.step(3), -0.125f);  // it was carried there
  EXPECT_EQ(reward.step(2), 0);
  reward.displace(9);
  EXPECT_EQ(reward.step(8), -0.125f);
}

TEST(Path, HoldsFourActionsAnOctet) {
  std::vector<std::uint8_t> path;
  const std::vector<std::uint8_t> actions = {kNext, kPrevious, kStay, kNext, kPrevious};
  for (std::size_t step = 0; step < actions.size(); ++step) append_action(path, step, actions[step]);
  EXPECT_EQ(path, (std::vector<std::uint8_t>{1 | 2 << 2 | 1 << 6, 2}));
  EXPECT_EQ(path.size(), path_octets(actions.size()));
  for (std::size_t step = 0; step < actions.size(); ++step) EXPECT_EQ(action_at(path, step), actions[step]);
  EXPECT_EQ(action_at(path, 8), kNoAction);
  EXPECT_EQ(path_octets(0), 0u);
  EXPECT_EQ(path_octets(4), 1u);
}

}  // namespace
}  // namespace citylearn
