// SPDX-License-Identifier: Apache-2.0
// A training run whose disk is full for a while: it goes on, says so, keeps what it had, and makes up for it when there
// is room again.
#include <gtest/gtest.h>

#include "policy_service/network/checkpoint/checkpoint.h"
#include "tests/support/processes/private_machine.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/ledger.h"
#include "tests/support/records/witness.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr seconds kLongWait{60};

bool any_temporary(const std::string& folder) {
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    if (entry.path().extension() == ".tmp") return true;
  return false;
}

TEST(FullDisk, TrainingGoesOnWithAlarmsAndMakesUpForItWhenThereIsRoom) {
  if (!enter_private_machine()) GTEST_SKIP() << "only root may have a small disk of its own";
  Trial run("cyclonedds");
  const std::string folder = run.folder() / "disk", out = folder + "/out", store = folder + "/dashboard.sqlite";
  const SmallDisk disk(folder, "16m");
  Witness witness("cyclonedds", run.domain());
  const auto recorder = run.recorder(store);
  const auto env = run.env("summer", {"--recorders", "dashboard", "--linger", "60"});
  const auto policy =
      run.policy({"--middleware", "lossy,drop=0.1,seed=3:cyclonedds", "--agent", "place_filter", "--steps",
                  "1000000000", "--checkpoint-every", "2", "--output", out, "--evaluate", "summer"});
  ASSERT_TRUE(witness.until([&] { return witness.updates >= 6; }, kLongWait)) << policy->output();

  disk.fill();
  const auto alarmed = [&](const std::string& id, const std::string& what) {
    return witness.alarm(id).find(what) != std::string::npos;
  };
  EXPECT_TRUE(witness.until(
      [&] {
        return alarmed("policy", "checkpoint: ") && alarmed("policy", "episodes.csv: ") &&
               alarmed("dashboard", "store: ");
      },
      kLongWait))
      << witness.alarm("policy") << "\n"
      << witness.alarm("dashboard") << "\n"
      << policy->output();
  EXPECT_TRUE(alarmed("policy", "No space left on device")) << witness.alarm("policy");
  const std::uint64_t updates = witness.updates;
  EXPECT_TRUE(witness.until([&] { return witness.updates > updates + 4; }, kLongWait)) << "training goes on";
  // What was there is there and whole, nothing is there in part.
  const auto newest = newest_checkpoint(out + "/checkpoints");
  ASSERT_TRUE(newest);
  EXPECT_NO_THROW(read_checkpoint(*newest));
  EXPECT_TRUE(witness.until([&] { return !any_temporary(out); }, kLongWait));
  EXPECT_EQ(contents(out + "/episodes.csv").back(), '\n');
  EXPECT_EQ(contents(out + "/metrics.csv").back(), '\n');

  disk.make_room();
  EXPECT_TRUE(
      witness.until([&] { return witness.alarm("policy").empty() && witness.alarm("dashboard").empty(); }, seconds(10)))
      << witness.alarm("policy") << "\n"
      << witness.alarm("dashboard");
  EXPECT_TRUE(witness.until([&] { return newest_checkpoint(out + "/checkpoints") != newest; }, kLongWait));
  EXPECT_NO_THROW(read_checkpoint(*newest_checkpoint(out + "/checkpoints")));

  env->send(SIGTERM);
  ASSERT_TRUE(witness.until([&] { return env->wait(milliseconds(1)).has_value(); }, kLongWait)) << env->output();
  EXPECT_TRUE(contains(env->output(), "all acknowledged"));
  EXPECT_EQ(policy->end(SIGTERM, kLongWait), 130) << policy->output();
  EXPECT_EQ(recorder->end(SIGTERM, kLongWait), 0) << recorder->output();
  const Ledger recorded = in_store(store), learned = in_csv(out + "/episodes.csv");
  EXPECT_EQ(recorded, learned);
  ASSERT_EQ(recorded.size(), 1u);
  EXPECT_TRUE(contains(env->output(), "stops: " + std::to_string(entries(recorded)) + " episodes"));
  expect_all_acknowledged(recorded, witness.acknowledged["dashboard"]);
  for (const std::string what : {"checkpoint", "episodes.csv"})
    EXPECT_TRUE(contains(policy->output(), what + ": the problem is solved")) << what;
}

TEST(FullDisk, AStartIsTriedAgainUntilThereIsRoom) {
  if (!enter_private_machine()) GTEST_SKIP() << "only root may have a small disk of its own";
  Trial run("cyclonedds");
  const SmallDisk disk(run.folder() / "disk", "16m");
  const auto env = run.env("summer");
  const auto first = run.train(4, "disk/out");
  ASSERT_EQ(first->wait(kLongWait), 0) << first->output();
  disk.fill();
  const auto second = run.train(4, "disk/out", {"--resume"});
  // Status 2 would be final for a supervisor.
  EXPECT_EQ(second->wait(kLongWait), 1) << second->output();
  EXPECT_TRUE(contains(second->output(), "No space left on device"));
  disk.make_room();
  const auto third = run.train(4, "disk/out", {"--resume"});
  EXPECT_EQ(third->wait(kLongWait), 0) << third->output();
  EXPECT_TRUE(contains(third->output(), "resuming after update 4"));
}

}  // namespace
}  // namespace citylearn::testing
