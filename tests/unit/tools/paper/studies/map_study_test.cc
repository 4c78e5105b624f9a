// SPDX-License-Identifier: Apache-2.0
// Routes that cross themselves, and policies on them.
#include <gtest/gtest.h>

#include <cmath>

#include "env_service/geometry/crossings.h"
#include "tests/unit/tools/paper/looped_recording.h"
#include "tools/lab/training.h"
#include "tools/paper/studies/study.h"

namespace citylearn::paper {
namespace {

TEST(Layouts, TheDrawnOneCrossesItselfSevenTimes) {
  for (const int places : {112, 128, 256, 500}) {
    const Layout layout = drawn_layout(places);
    ASSERT_EQ(layout.latitude.size(), static_cast<std::size_t>(places));
    const auto junctions = junctions_of(layout.turns);
    EXPECT_EQ(junctions.size(), 7u) << places;
    for (const auto& joined : junctions) EXPECT_EQ(joined.size(), 2u);
    const auto [east, north] = metres_of(layout);
    for (const int place : {0, 1, places - 2}) {
      const auto i = static_cast<std::size_t>(place);
      EXPECT_NEAR(std::hypot(east[i + 1] - east[i], north[i + 1] - north[i]), 10, 1) << places;
    }
  }
}

TEST(Layouts, OfRecordingsAreWhereTheyCrossThemselves) {
  const Traversal traversal = looped_recording();
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

TEST(MapStudy, JunctionsMakeWaysShorter) {
  WorldOptions options;
  options.source.parameters["synthetic"] = {{"images", 0}, {"frames", 90}};
  World world(options);
  Study study;
  study.kind = Study::Kind::kControl;
  study.representation = "features";
  study.map = drawn_layout(80);
  study.frames = 80;
  study.tasks = 200;
  study.traversals = {"summer", "winter"};
  const auto of = [&](const std::string& policy, bool junctions, const char* figure) {
    study.policy = policy;
    study.junctions = junctions;
    return unit_of(study, world).compute()["trials"][0][figure];
  };
  EXPECT_EQ(of("shortest_path", true, "spl")["mean"].get<double>(), 1);
  EXPECT_EQ(of("shortest_path", true, "steps")["mean"].get<double>(),
            of("shortest_path", true, "shortest")["mean"].get<double>());
  EXPECT_EQ(of("shortest_path", false, "completed")["mean"].get<double>(), 1);
  EXPECT_LT(of("shortest_path", false, "spl")["mean"].get<double>(), 0.9) << "its way is the longer one";
  EXPECT_LT(of("shortest_path", true, "steps")["mean"].get<double>(),
            0.8 * of("shortest_path", false, "steps")["mean"].get<double>());
  EXPECT_GT(of("sequence_filter", true, "spl")["mean"].get<double>(), 0.95);
  EXPECT_LT(of("blind", false, "spl")["mean"].get<double>(), of("shortest_path", false, "spl")["mean"].get<double>());
  EXPECT_EQ(of("blind", false, "steps")["n"], 200);
  const Json walk = unit_of(study, world).compute()["walk"];
  EXPECT_EQ(walk["places"].front(), walk["start"]);
}

TEST(MapStudy, TrainingIsTheSameAgain) {
  WorldOptions options;
  options.source.parameters["synthetic"] = {{"images", 0}, {"frames", 90}};
  World world(options);
  Study study;
  study.policy = "place_filter";
  study.junctions = true;
  study.representation = "features";
  study.map = drawn_layout(80);
  study.frames = 80;
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

}  // namespace
}  // namespace citylearn::paper
