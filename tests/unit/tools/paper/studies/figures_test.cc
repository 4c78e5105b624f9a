// SPDX-License-Identifier: Apache-2.0
// Figures with intervals, and where agents walked.
#include <gtest/gtest.h>

#include <cmath>

#include "core/util/error.h"
#include "tools/paper/studies/statistics.h"
#include "tools/paper/studies/walk.h"

namespace citylearn::paper {
namespace {

TEST(Statistics, MeansHaveStudentsInterval) {
  const Json estimate = mean_estimate({1, 2, 3, 4, 5});
  EXPECT_EQ(estimate["n"], 5);
  EXPECT_DOUBLE_EQ(estimate["mean"].get<double>(), 3);
  // t(0.975, 4) = 2.776445; s = sqrt(2.5).
  EXPECT_NEAR(estimate["high"].get<double>() - 3, 2.776445 * std::sqrt(2.5 / 5), 1e-5);
  EXPECT_NEAR(estimate["low"].get<double>() + estimate["high"].get<double>(), 6, 1e-12);
}

TEST(Statistics, OneValueHasNoIntervalAndNoneNoMean) {
  EXPECT_EQ(mean_estimate({7}), (Json{{"mean", 7.0}, {"low", nullptr}, {"high", nullptr}, {"n", 1}}));
  EXPECT_TRUE(mean_estimate({})["mean"].is_null());
  EXPECT_EQ(mean_estimate({NAN, 2, INFINITY, 4})["n"], 2);
}

TEST(Statistics, SharesHaveWilsonsInterval) {
  const Json all = share_estimate(100, 100);
  EXPECT_DOUBLE_EQ(all["mean"].get<double>(), 1);
  EXPECT_NEAR(all["low"].get<double>(), 0.963, 0.001);  // not 1: a hundred successes prove no more
}

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

TEST(Layouts, PathsAreFollowedOverJunctions) {
  const std::vector<int> turns = {0, 4, 2, 3, 1, 5};
  // next, stay, previous, stay, previous, previous
  const std::vector<std::uint8_t> path = {1 | 0 << 2 | 2 << 4 | 0 << 6, 2 | 2 << 2};
  EXPECT_EQ(places_walked(0, 6, path, turns, 6), (std::vector<int>{0, 1, 4, 3, 3, 2, 1}));
  EXPECT_THROW(places_walked(0, 6, path, {}, 6), Error) << "without junctions it leads off the route";
  EXPECT_THROW(places_walked(0, 9, path, turns, 6), Error) << "there are no more actions";
}

}  // namespace
}  // namespace citylearn::paper
