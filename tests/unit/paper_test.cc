// Parts of ./run paper: figures with intervals, work that is done once, charts.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "core/error.h"
#include "tests/support/service.h"
#include "tools/chart/chart.h"
#include "tools/paper/statistics.h"
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
