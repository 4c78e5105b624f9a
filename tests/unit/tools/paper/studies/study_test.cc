// SPDX-License-Identifier: Apache-2.0
// Agents trained once and tried elsewhere.
#include "tools/paper/studies/study.h"

#include <gtest/gtest.h>

#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::paper {
namespace {

using citylearn::testing::Folder;

Source drawn(int frames) {
  Source source;
  source.parameters["synthetic"] = {{"frames", static_cast<double>(frames)}, {"images", 0}};
  return source;
}

Study short_study() {
  Study study;
  study.policy = "place_filter";
  study.learner = "relabel";
  study.representation = "features";
  study.frames = 12;
  study.steps = 1024;
  study.tasks = 20;
  study.traversals = {"summer"};
  study.save_parameters = true;
  return study;
}

TEST(TransferTrials, UseTheSavedAgentBitForBit) {
  WorldOptions options;
  options.source = drawn(24);
  World world(options);
  const Folder folder;
  const Study source = short_study();
  Study task = source;
  task.kind = Study::Kind::kUnchanged;
  task.traversals = {"summer", "fall"};
  const auto transferred_to = [&](int first, const Work& work) {
    task.first = first;
    task.initial = saved_agent(source, world, work);
    return unit_of(task, world);
  };
  Study further = source;
  further.save_parameters = false;
  further.first = 12;
  further.frozen = {"filter"};

  Json here;
  for (const std::string run : {"one", "two"}) {
    Work work(folder / run);
    work.add(unit_of(source, world));
    work.add(transferred_to(0, work));
    work.add(transferred_to(12, work));
    further.initial = saved_agent(source, world, work);
    work.add(unit_of(further, world));
    ASSERT_TRUE(work.run());
    const Json& trained = work.outcome(unit_of(source, world).spec);
    Json again = work.outcome(transferred_to(0, work).spec)[0];
    again["shuffled"] = false;
    Json before = trained["trials"][0];
    before.erase("walk");  // shown of trainings alone
    EXPECT_EQ(again, before) << "on its own route it does what it did";
    EXPECT_NE(work.outcome(transferred_to(12, work).spec)[0], again);
    Json outcome = work.outcome(unit_of(further, world).spec);
    EXPECT_FALSE(outcome.contains("parameters"));
    EXPECT_GE(outcome["steps"], 1024);
    if (run == "one")
      here = outcome["trials"];
    else
      EXPECT_EQ(here, outcome["trials"]);
  }
}

TEST(TransferTrials, FailWithTheTrainingTheyNeed) {
  WorldOptions options;
  options.source = drawn(24);
  World world(options);
  const Folder folder;
  Work work(folder / "work");
  Study impossible = short_study();
  impossible.frozen = {"nothing of that name"};
  work.add(unit_of(impossible, world));
  Study task = short_study();
  task.kind = Study::Kind::kUnchanged;
  task.initial = saved_agent(impossible, world, work);
  const Unit transfer = unit_of(task, world);
  work.add(transfer);
  EXPECT_FALSE(work.run());
  EXPECT_TRUE(work.outcome(transfer.spec).is_null());
}

/// Studies of two experiences are work of their own, and bad ones name the traversal.
TEST(Studies, LearnFromSeveralExperiences) {
  WorldOptions options;
  options.source = drawn(24);
  World world(options);
  const Folder folder;
  Work work(folder / "work");
  Study alone = short_study(), both = alone;
  both.experiences = {"fall"};
  alone.traversals = both.traversals = {"winter"};
  alone.save_parameters = both.save_parameters = true;
  Study control = alone, knows_winter = alone;
  control.kind = knows_winter.kind = Study::Kind::kControl;
  control.policy = knows_winter.policy = "sequence_filter";
  knows_winter.experiences = {"winter"};
  for (const Study& study : {alone, both, control, knows_winter}) work.add(unit_of(study, world));
  ASSERT_TRUE(work.run());
  ASSERT_EQ(work.units(), 4);
  EXPECT_NE(work.outcome(0)["parameters"], work.outcome(1)["parameters"]);
  EXPECT_GE(work.outcome(3)[0]["spl"], work.outcome(2)[0]["spl"]) << "it remembers what it is shown";

  Traversal city = world.traversal("features", "summer"), narrow = city;
  city.name = "A";
  narrow.name = "B";
  narrow.dimension = 8;
  EXPECT_EQ(network_task({&city, &city}, 0, 12).reference.cols(), 24);
  using citylearn::testing::error_of;
  EXPECT_EQ(error_of([&] {
              network_task({&city, &narrow}, 0, 12);
            }),
            "traversal 'B': has 8 features a frame, 'A' has 64 (train on traversals with features of one kind)");
  narrow = city;
  narrow.frames = 10;
  EXPECT_EQ(error_of([&] {
              network_task({&city, &narrow}, 0, 12);
            }),
            "traversal 'A': has 10 frames, the route needs frames 0..11 (choose fewer)");
}

}  // namespace
}  // namespace citylearn::paper
