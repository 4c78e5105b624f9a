// SPDX-License-Identifier: Apache-2.0
// Where agents walked.
#include <gtest/gtest.h>

#include <cstdlib>

#include "core/util/error.h"
#include "tools/paper/studies/walk.h"

namespace citylearn::paper {
namespace {

Environment::Episode episode(int task, int start, int goal, const std::vector<int>& actions) {
  Environment::Episode made{0, task, start, goal, static_cast<int>(actions.size()), std::abs(goal - start),
                            0, true, {}};
  for (std::size_t i = 0; i < actions.size(); ++i) {
    if (i % 4 == 0) made.path.push_back(0);
    made.path.back() = static_cast<std::uint8_t>(made.path.back() | actions[i] << 2 * (i % 4));
  }
  return made;
}

TEST(Walks, AreOfTheLongestWayAmongTheFirstTasks) {
  std::vector<Environment::Episode> episodes;
  for (int task = 0; task < 30; ++task) episodes.push_back(episode(task, 9, 8, {kPrevious}));
  episodes[4] = episode(4, 2, 5, {kNext, kStay, kNext, kPrevious, kNext, kNext});
  episodes[7] = episode(7, 5, 2, {kPrevious, kPrevious, kPrevious});
  episodes[25] = episode(25, 0, 50, {});
  const Json walk = walk_of(episodes, 200);
  EXPECT_EQ(walk["task"], 4);
  EXPECT_EQ(walk["goal"], 5);
  EXPECT_EQ(walk["frames"], (std::vector<int>{2, 3, 3, 4, 3, 4, 5}));
}

TEST(Walks, ArePicturedFromStartToEnd) {
  EXPECT_EQ(spread(3, 9), (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(spread(101, 5), (std::vector<int>{0, 25, 50, 75, 100}));
}

TEST(Walks, StayOnTheRoute) { EXPECT_THROW(walk_of({episode(0, 0, 9, {kPrevious})}, 10), Error); }

}  // namespace
}  // namespace citylearn::paper
