// Parts of ./run paper: figures with intervals, work that is done once, charts.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "core/error.h"
#include "tests/support/service.h"
#include "tools/chart/chart.h"
#include "tools/paper/curve.h"
#include "tools/paper/report.h"
#include "tools/paper/sha256.h"
#include "tools/paper/statistics.h"
#include "tools/paper/walk.h"
#include "tools/paper/work.h"

namespace citylearn::paper {
namespace {

using citylearn::testing::Folder;

TEST(Statistics, MeansHaveStudentsInterval) {
  const Estimate estimate = of_mean({1, 2, 3, 4, 5});
  EXPECT_EQ(estimate.n, 5);
  EXPECT_DOUBLE_EQ(estimate.mean, 3);
  // t(0.975, 4) = 2.776445; s = sqrt(2.5).
  EXPECT_NEAR(estimate.high - 3, 2.776445 * std::sqrt(2.5 / 5), 1e-5);
  EXPECT_NEAR(estimate.low + estimate.high, 6, 1e-12);
}

TEST(Statistics, OneValueHasNoIntervalAndNoneNoMean) {
  EXPECT_DOUBLE_EQ(of_mean({7}).mean, 7);
  EXPECT_TRUE(std::isnan(of_mean({7}).low));
  EXPECT_TRUE(std::isnan(of_mean({}).mean));
  EXPECT_EQ(of_mean({NAN, 2, INFINITY, 4}).n, 2);
}

TEST(Statistics, SharesHaveWilsonsInterval) {
  const Estimate all = of_share(100, 100);
  EXPECT_DOUBLE_EQ(all.mean, 1);
  EXPECT_NEAR(all.low, 0.963, 0.001);  // not 1: a hundred successes prove no more
}

TEST(Statistics, SmoothingHasNoPullToZero) {
  const std::vector<double> same = smoothed({5, 5, NAN, 5}, 0.9);
  for (const double value : same) EXPECT_DOUBLE_EQ(value, 5);
}

TEST(Statistics, InterpolatesBetweenPointsOnly) {
  const std::vector<double> y = interpolated({1, 3}, {10, 30}, {0, 1, 2, 3, 4});
  EXPECT_TRUE(std::isnan(y[0]) && std::isnan(y[4]));
  EXPECT_DOUBLE_EQ(y[1], 10);
  EXPECT_DOUBLE_EQ(y[2], 20);
  EXPECT_DOUBLE_EQ(y[3], 30);
}

Unit counted(int number, int& times) {
  return {"unit", {{"number", number}}, 1, [&times, number] {
            ++times;
            return Json(number * number);
          }};
}

TEST(Work, IsDoneOnceAndFoundAgain) {
  const Folder folder;
  int times = 0;
  {
    Work work(folder / "work");
    work.add(counted(3, times));
    work.add(counted(3, times));
    work.add(counted(4, times));
    EXPECT_EQ(work.units(), 2);
    EXPECT_TRUE(work.run());
    EXPECT_EQ(work.outcome({{"number", 4}}), 16);
  }
  Work again(folder / "work");
  again.add(counted(3, times));
  again.add(counted(5, times));
  EXPECT_TRUE(again.run());
  EXPECT_EQ(times, 3);
  EXPECT_EQ(again.outcome({{"number", 3}}), 9);
  EXPECT_TRUE(again.outcome({{"number", 4}}).is_null()) << "not asked for by this run";
}

TEST(Work, WhatFailsOrIsDamagedIsDoneAgain) {
  const Folder folder;
  int times = 0;
  {
    Work work(folder / "work");
    work.add({"bad", {{"bad", 1}}, 1, []() -> Json { throw Error("cannot be done"); }});
    work.add(counted(2, times));
    EXPECT_FALSE(work.run());
    EXPECT_TRUE(work.outcome({{"bad", 1}}).is_null());
    EXPECT_EQ(work.outcome({{"number", 2}}), 4) << "the others go on";
  }
  for (const auto& file : std::filesystem::directory_iterator(folder / "work")) std::ofstream(file.path()) << "{\"half";
  Work again(folder / "work");
  again.add(counted(2, times));
  EXPECT_TRUE(again.run());
  EXPECT_EQ(times, 2);
}

TEST(Work, WhatIsCompleteStaysWhenItStops) {
  const Folder folder;
  int times = 0;
  {
    Work work(folder / "work");
    work.add(counted(2, times));
    work.add({"stopped", {{"stopped", 1}}, 1, []() -> Json { throw Stopped{}; }});
    EXPECT_THROW(work.run(), Stopped);
  }
  Work again(folder / "work");
  again.add(counted(2, times));
  EXPECT_TRUE(again.run());
  EXPECT_EQ(times, 1);
}

TEST(Work, ResultsAreWithoutWhatTheMachineDecides) {
  const Json outcome = {
      {"seconds", 3}, {"rows", {{{"spl", 0.5}, {"seconds", {1, 2}}}, nullptr, 7}}, {"bytes", {{"a", 1}}}};
  EXPECT_EQ(repeatable(outcome), (Json{{"rows", {{{"spl", 0.5}}, nullptr, 7}}}));
  const Folder folder;
  Work work(folder / "work");
  int times = 0;
  work.add({"timed", {{"timed", 1}}, 1, [&] { return Json{{"seconds", ++times}, {"spl", 1}}; }});
  work.add({"bad", {{"bad", 1}}, 1, []() -> Json { throw Error("cannot be done"); }});
  EXPECT_FALSE(work.run());
  const Json results = Json::parse(work.results());
  ASSERT_EQ(results.size(), 2u);
  EXPECT_EQ(results[0], (Json{{"name", "timed"}, {"spec", {{"timed", 1}}}, {"outcome", {{"spl", 1}}}}));
  EXPECT_TRUE(results[1]["outcome"].is_null());
  EXPECT_TRUE(work.times()[0]["seconds"].is_number());
  EXPECT_TRUE(work.times()[1]["seconds"].is_null());
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
  const Json walk = walk_of(episodes);
  EXPECT_EQ(walk["task"], 4);
  EXPECT_EQ(walk["goal"], 5);
  EXPECT_EQ(walk["frames"], (std::vector<int>{2, 3, 3, 4, 3, 4, 5}));
}

TEST(Walks, ArePicturedFromStartToEnd) {
  EXPECT_EQ(spread(3, 9), (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(spread(101, 5), (std::vector<int>{0, 25, 50, 75, 100}));
}

TEST(Curves, EndWithTheLastEpisodes) {
  Json outcome = {{"curve", {{"episodes", {100, 200, 1000, 1000, 1400}}, {"reward", {0, 0, 0.5, nullptr, 0.8}}}}};
  EXPECT_DOUBLE_EQ(final_value(outcome, "reward"), (800 * 0.5 + 400 * 0.8) / 1200);
  outcome["curve"] = {{"episodes", Json::array()}, {"reward", Json::array()}};
  EXPECT_TRUE(std::isnan(final_value(outcome, "reward")));
}

TEST(Reports, WriteEachNumberOfAChart) {
  const Folder folder;
  Report report(folder.path());
  report.figure("one", Chart{"one", {"x"}, {"y, m"}, {{"a, b", {0, 0.5}, {1, NAN}, {0.5, NAN}, {2, NAN}}}}, "first");
  EXPECT_EQ(citylearn::testing::contents(folder / "one-lines.csv"),
            "line,x,\"y, m\",low,high\n\"a, b\",0,1,0.5,2\n\"a, b\",0.5,,,\n");
  report.figure("two", Bars{"two", "AUC", {"night"}, {"hog", "vlad"}, {{{0.25, 0.125, 0.5}, {NAN, NAN, NAN}}}},
                "second");
  EXPECT_EQ(citylearn::testing::contents(folder / "two-bars.csv"),
            "group,bar,AUC,low,high\nnight,hog,0.25,0.125,0.5\nnight,vlad,,,\n");
  EXPECT_EQ(report.files().at("two-bars.csv"), sha256(citylearn::testing::contents(folder / "two-bars.csv")));
  EXPECT_THROW(report.figure("one", Chart{}, "again"), Error) << "the first would be lost";
}

TEST(Charts, DotsAreNotJoined) {
  Chart chart{"dots", decades_around("s", {3, 250, NAN, 0}), {"y"}, {{"seeds", {3, 250, NAN}, {0.5, 0.7, 0.9}}}};
  chart.lines.front().dots = true;
  const std::string svg = svg_of(chart);
  EXPECT_EQ(svg.find("<polyline"), svg.npos);
  std::size_t circles = 0;
  for (std::size_t at = svg.find("<circle"); at != svg.npos; at = svg.find("<circle", at + 1)) ++circles;
  EXPECT_EQ(circles, 3u) << "two seeds and the legend";
  EXPECT_DOUBLE_EQ(chart.x.low, 1);
  EXPECT_DOUBLE_EQ(chart.x.high, 1000);
}

TEST(Charts, LeaveOutWhatIsNotFinite) {
  Chart chart{"a < b", {"x"}, {"y"}, {{"line", {0, 0.5, 1}, {0, NAN, 1}}}};
  const std::string svg = svg_of(chart);
  EXPECT_EQ(svg.find("nan"), svg.npos);
  EXPECT_NE(svg.find("a &lt; b"), svg.npos);
}

TEST(Charts, AxesHoldAllValues) {
  const Axis axis = axis_around("x", {-3, 17, NAN});
  EXPECT_LE(axis.low, -3);
  EXPECT_GE(axis.high, 17);
  EXPECT_EQ(axis_around("x", {}).high, 1);
  EXPECT_EQ(axis_around("x", {5, 9}, /*from_zero=*/true).low, 0);
}

}  // namespace
}  // namespace citylearn::paper
