// SPDX-License-Identifier: Apache-2.0
// Agents trained once and tried elsewhere.
#include "tools/paper/studies/study.h"

#include <gtest/gtest.h>

#include "tests/support/processes/service.h"

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
  study.agent = "place_filter";
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
  const auto transferred_to = [&](int first, const Work& work) {
    return unit_of(TransferTrial{saved_agent(source, world, work), "features", first, 12, 20, {"summer", "fall"}},
                   world);
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
  const Unit transfer =
      unit_of(TransferTrial{saved_agent(impossible, world, work), "features", 12, 12, 20, {"summer"}}, world);
  work.add(transfer);
  EXPECT_FALSE(work.run());
  EXPECT_TRUE(work.outcome(transfer.spec).is_null());
}

}  // namespace
}  // namespace citylearn::paper
