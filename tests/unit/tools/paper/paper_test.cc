// SPDX-License-Identifier: Apache-2.0
// Parts of ./run paper: figures with intervals, work that is done once, charts.
#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "core/util/error.h"
#include "core/util/files.h"
#include "core/util/sha256.h"
#include "env_service/dataset_io/crossings.h"
#include "tests/support/service.h"
#include "tools/chart/chart.h"
#include "tools/paper/curve.h"
#include "tools/paper/map_study.h"
#include "tools/paper/report.h"
#include "tools/paper/section.h"
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

TEST(Statistics, IntervalsEndWhereNoValueCanLie) {
  const Estimate estimate = of_mean({0.9, 1}, kShares);
  EXPECT_DOUBLE_EQ(estimate.mean, 0.95);
  EXPECT_EQ(estimate.low, of_mean({0.9, 1}).low);
  EXPECT_EQ(estimate.high, 1);
  EXPECT_EQ(of_mean({3, 50}, kCounts).low, 0);
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

TEST(Work, WhatAnotherRunHasDoneMeanwhileIsNotDoneAgain) {
  const Folder folder;
  int times = 0;
  const auto other_run = [&]() -> Json {
    Work other(folder / "work");
    other.add(counted(3, times));
    EXPECT_TRUE(other.run());
    return 1;
  };
  Work work(folder / "work");
  work.add({"slow", {{"slow", 1}}, 1, other_run});
  work.add(counted(3, times));
  EXPECT_TRUE(work.run());
  EXPECT_EQ(times, 1);
  EXPECT_EQ(work.outcome({{"number", 3}}), 9);
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
  const Json walk = walk_of(episodes, 200);
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

TEST(Curves, OfSeedsThatEndEarlierDoNotLeap) {
  const auto outcome = [](double episodes, double reward) {
    return Json{{"episodes", episodes},
                {"curve", {{"episodes", {1, episodes / 2, episodes}}, {"reward", {reward, reward, reward}}}}};
  };
  const Line line = mean_curve("two seeds", {outcome(400, -1), outcome(1000, 0.5)}, "reward", 0.9);
  EXPECT_EQ(line.x.back(), 1000);
  for (std::size_t i = 0; i < line.x.size(); ++i) EXPECT_DOUBLE_EQ(line.y[i], -0.25) << line.x[i];
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

TEST(Charts, LongNumbersKeepClearOfTheAxisLabel) {
  const auto left = [](double low, double high) {  // of the plot area: where its grid begins
    const std::string svg = svg_of(Chart{"", {"x"}, {"y", low, high}, {}});
    const std::string before = "class=\"grid\" d=\"M";
    return std::stod(svg.substr(svg.find(before) + before.size()));
  };
  EXPECT_EQ(left(0, 1), left(0, 100));
  EXPECT_GT(left(0.985, 1), left(0, 1)) << "0.995 is longer than 0.8";
  EXPECT_GT(left(-0.0025, 0), left(0.985, 1));
}

TEST(Charts, ALineOfOnePointIsADot) {
  Chart chart{"one", {"x"}, {"y"}, {{"", {0.5}, {0.5}}}};
  EXPECT_NE(svg_of(chart).find("<circle"), std::string::npos);
  chart.lines.front().x.push_back(1);
  chart.lines.front().y.push_back(1);
  EXPECT_EQ(svg_of(chart).find("<circle"), std::string::npos);
}

TEST(Charts, AxesHoldAllValues) {
  const Axis axis = axis_around("x", {-3, 17, NAN});
  EXPECT_LE(axis.low, -3);
  EXPECT_GE(axis.high, 17);
  EXPECT_EQ(axis_around("x", {}).high, 1);
  EXPECT_EQ(axis_around("x", {5, 9}, /*from_zero=*/true).low, 0);
}

TEST(Charts, PointsAreDotsThatNoLineJoins) {
  Chart chart{"dots", {"x"}, {"y"}, {{"", {0, 0.5, 1}, {0, NAN, 1}}}};
  EXPECT_EQ(svg_of(chart).find("<circle"), std::string::npos);
  chart.lines[0].dots = true;
  const std::string svg = svg_of(chart);
  EXPECT_EQ(svg.find("<polyline"), std::string::npos);
  std::size_t dots = 0;
  for (std::size_t at = 0; (at = svg.find("<circle", at)) != std::string::npos; ++at) ++dots;
  EXPECT_EQ(dots, 2u) << "one is not finite, and a line without a label is not in the legend";
}

TEST(Layouts, TheDrawnOneCrossesItselfSevenTimes) {
  for (const int places : {112, 128, 256, 500}) {
    const Layout layout = drawn_layout(places);
    ASSERT_EQ(layout.latitude.size(), static_cast<std::size_t>(places));
    const auto junctions = junctions_of(layout.turns);
    EXPECT_EQ(junctions.size(), 7u) << places;
    for (const auto& joined : junctions) EXPECT_EQ(joined.size(), 2u);
    const Line line = on_the_map(layout, "", {0, 1, 2, places - 2, places - 1});
    for (const std::size_t i : {0u, 1u, 3u})
      EXPECT_NEAR(std::hypot(line.x[i + 1] - line.x[i], line.y[i + 1] - line.y[i]), 10, 1) << places;
  }
}

/// A straight road, then a loop that crosses it, with a gap in the GPS.
Traversal recording() {
  Traversal traversal;
  traversal.name = "looped";
  traversal.frames = 100;
  for (int i = 0; i < 100; ++i) {
    const double east = i < 60 ? i : i < 70 ? 60 : i < 90 ? 60 - (i - 70) : 40;
    const double north = i < 60 ? 0 : i < 70 ? i - 60 : i < 90 ? 10 : 10 - 2 * (i - 90);
    traversal.latitude.push_back(i == 5 ? NAN : 48 + north * 1e-4);
    traversal.longitude.push_back(11 + east * 1e-4);
  }
  return traversal;
}

TEST(Layouts, OfRecordingsAreWhereTheyCrossThemselves) {
  const Traversal traversal = recording();
  const Layout layout = recorded_layout(traversal, 70);
  ASSERT_EQ(junctions_of(layout.turns).size(), 1u);
  EXPECT_EQ(layout.frames, 70);
  const int before = layout.first + junctions_of(layout.turns)[0][0],
            after = layout.first + junctions_of(layout.turns)[0][1];
  EXPECT_NEAR(before, 40, 1);
  EXPECT_NEAR(after, 95, 1);
  EXPECT_EQ(layout.latitude[0], traversal.latitude[static_cast<std::size_t>(layout.first)]);
  EXPECT_TRUE(recorded_layout(traversal, 40).turns.empty()) << "no stretch so short crosses itself";
  Traversal lost = traversal;
  lost.latitude.clear();
  lost.longitude.clear();
  EXPECT_TRUE(recorded_layout(lost, 70).turns.empty());
}

TEST(Layouts, ChartsAreToScale) {
  const Chart chart = map_of(drawn_layout(128), "map");
  EXPECT_NEAR(chart.width / (chart.x.high - chart.x.low), chart.height / (chart.y.high - chart.y.low), 1e-9);
  ASSERT_EQ(chart.lines.size(), 2u);
  EXPECT_EQ(chart.lines[1].label, "its 7 junctions");
  EXPECT_EQ(chart.lines[1].x.size(), 14u);
}

TEST(Layouts, PathsAreFollowedOverJunctions) {
  const std::vector<int> turns = {0, 4, 2, 3, 1, 5};
  // next, stay, previous, stay, previous, previous
  const std::vector<std::uint8_t> path = {1 | 0 << 2 | 2 << 4 | 0 << 6, 2 | 2 << 2};
  EXPECT_EQ(places_walked(0, 6, path, turns, 6), (std::vector<int>{0, 1, 4, 3, 3, 2, 1}));
  EXPECT_THROW(places_walked(0, 6, path, {}, 6), Error) << "without junctions it leads off the route";
  EXPECT_THROW(places_walked(0, 9, path, turns, 6), Error) << "there are no more actions";
}

TEST(MapStudy, JunctionsMakeWaysShorter) {
  WorldOptions options;
  options.source.parameters["synthetic"] = {{"images", 0}, {"frames", 90}};
  World world(options);
  MapStudy study;
  study.learns = false;
  study.representation = "features";
  study.layout = drawn_layout(80);
  study.tasks = 200;
  study.traversals = {"summer", "winter"};
  const auto of = [&](const std::string& policy, bool junctions, const char* figure) {
    study.policy = policy;
    study.junctions = junctions;
    return estimate_of(unit_of(study, world).compute()["trials"][0][figure]);
  };
  EXPECT_EQ(of("shortest_path", true, "spl").mean, 1);
  EXPECT_EQ(of("shortest_path", true, "steps").mean, of("shortest_path", true, "shortest").mean);
  EXPECT_EQ(of("shortest_path", false, "completed").mean, 1);
  EXPECT_LT(of("shortest_path", false, "spl").mean, 0.9) << "its way is the longer one";
  EXPECT_LT(of("shortest_path", true, "steps").mean, 0.8 * of("shortest_path", false, "steps").mean);
  EXPECT_GT(of("sequence_filter", true, "spl").mean, 0.95);
  EXPECT_LT(of("blind", false, "spl").mean, of("shortest_path", false, "spl").mean);
  EXPECT_EQ(of("blind", false, "steps").n, 200);
  const Json walk = unit_of(study, world).compute()["walk"];
  EXPECT_EQ(walk["places"].front(), walk["start"]);
}

TEST(MapStudy, TrainingIsTheSameAgain) {
  WorldOptions options;
  options.source.parameters["synthetic"] = {{"images", 0}, {"frames", 90}};
  World world(options);
  MapStudy study;
  study.policy = "place_filter";
  study.representation = "features";
  study.layout = drawn_layout(80);
  study.steps = 3000;
  study.tasks = 20;
  study.traversals = {"summer", "night"};
  const Unit unit = unit_of(study, world);
  const Json outcome = unit.compute();
  EXPECT_EQ(outcome, unit.compute());
  EXPECT_EQ(outcome["trials"].size(), 2u);
  EXPECT_GE(outcome["steps"], 3000);
  EXPECT_EQ(outcome["curve"]["episodes"].size(), outcome["curve"]["spl"].size());
  study.junctions = false;
  EXPECT_NE(unit_of(study, world).spec, unit.spec);
}

/// The trainer's own SPL is by the distances that the environment knows.
TEST(MapStudy, TheTrainerMeasuresOnTheMap) {
  WorldOptions options;
  options.source.parameters["synthetic"] = {{"images", 0}, {"frames", 80}};
  World world(options);
  Traversal route = world.traversal("features", "summer");
  route.turns = drawn_layout(80).turns;
  InprocessTraining training({}, route, route.frames);
  double spl = 0;
  int episodes = 0, line = 0, map = 0;
  while (episodes < 20) {
    training.update();
    for (const Environment::Episode& episode : training.finished()) {
      ++episodes;
      line += std::abs(episode.goal - episode.start);
      map += episode.shortest;
      if (episode.completed) spl += static_cast<double>(episode.shortest) / std::max(episode.shortest, episode.steps);
    }
  }
  ASSERT_LE(episodes, 100) << "the trainer tells of the last hundred";
  EXPECT_LT(map, line);
  EXPECT_NEAR(training.trainer().progress().spl, spl / episodes, 1e-9);
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = 0; (at = text.find(part, at)) != std::string::npos; at += part.size()) ++found;
  return found;
}

/// The section on a map, made in a second.
class MapSection : public ::testing::Test {
 protected:
  MapSection() : work_(folder_ / "work"), section_(make_map()) {}

  Context context(World& world, World& drawn) {
    return {.world = world,
            .drawn = drawn,
            .work = work_,
            .quick = true,
            .effort = 0.01,
            .seeds = {1, 2},
            .frames = 128,
            .command = "./run paper",
            .agents = {}};
  }
  static WorldOptions city() {
    WorldOptions options;
    options.source.parameters["synthetic"] = {{"images", 0}, {"frames", 130}};
    return options;
  }
  std::string told(const Context& context) const {
    Report report(folder_.path());
    report.section(section_->name(), section_->title());
    section_->tell(context, report);
    report.write("title", "about");
    return read_file(folder_ / "report.html");
  }

  const Folder folder_;
  Work work_;
  const std::unique_ptr<Section> section_;
};

TEST_F(MapSection, TellsWhatCameOfItAndWhatDidNot) {
  World world(city());
  Context context = this->context(world, world);
  section_->plan(context);
  EXPECT_EQ(work_.units(), 2 * (2 + 1 + 2) + 1);
  EXPECT_NE(told(context).find("7 junctions"), std::string::npos) << "nothing is done yet: the map is there";
  EXPECT_EQ(count(read_file(folder_ / "map.csv"), "\n"), 1u) << "a heading";
  ASSERT_TRUE(work_.run());
  const std::string report = told(context);
  EXPECT_NE(report.find("less than the sequence filter"), std::string::npos) << "such short training is not enough";
  EXPECT_EQ(count(read_file(folder_ / "map.csv"), "\n"), 1 + 3 * 9u);
  const std::string map = read_file(folder_ / "map.svg");
  EXPECT_NE(map.find("with junctions: "), std::string::npos);
  EXPECT_NE(map.find("without: "), std::string::npos);
}

TEST_F(MapSection, TakesRecordingsThatCrossThemselves) {
  const std::string data = folder_ / "data";
  std::filesystem::create_directories(data);
  const Traversal traversal = recording();
  Random random{5};
  for (const std::string name : {"day", "night"}) {
    std::ofstream features(data + "/" + name + ".csv"), poses(data + "/" + name + ".poses.csv");
    poses << "frame,lat,lon\n";
    for (int i = 0; i < traversal.frames; ++i) {
      for (int k = 0; k < 8; ++k) features << random.normal() << (k < 7 ? "," : "\n");
      const auto at = static_cast<std::size_t>(i);
      if (std::isfinite(traversal.latitude[at]))
        poses << i << fmt::format(",{:.6f},{:.6f}\n", traversal.latitude[at], traversal.longitude[at]);
    }
  }
  WorldOptions options;
  options.source.dataset = "plain";
  options.source.folder = data;
  options.source.traversal = "day";
  options.source.selection.by = "index";  // night's features are no help in finding places, nor is a gap
  World world(options), drawn(city());
  Context context = this->context(world, drawn);
  section_->plan(context);
  const std::string report = told(context);
  EXPECT_NE(report.find("1 junction of places within 1.5 mean steps"), std::string::npos) << report;
  EXPECT_NE(report.find("The recordings are real."), std::string::npos);
}

}  // namespace
}  // namespace citylearn::paper
