// SPDX-License-Identifier: Apache-2.0
// Sweeps: one policy_service, several seeds, env_services that stay.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/paths.h"
#include "tests/support/processes/service.h"
#include "tests/support/processes/trial.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

Json json_of(const std::string& path) { return Json::parse(contents(path)); }

TEST(Sweep, EachSeedIsTheRunThatItWouldBeAlone) {
  Trial run("cyclonedds");
  const auto summer = run.env("summer");
  const auto sweep = run.train(8, "sweep", {"--lockstep", "--seeds", "3,5,4", "--controls", "blind"});
  ASSERT_EQ(sweep->wait(kLongWait), 0) << sweep->output();
  const auto alone = run.train(8, "alone", {"--lockstep", "--seed", "5"});
  ASSERT_EQ(alone->wait(kLongWait), 0) << alone->output();
  ASSERT_FALSE(run.checkpoint("alone").second.empty());
  EXPECT_TRUE(run.checkpoint("sweep/seed-5") == run.checkpoint("alone"));
  EXPECT_FALSE(run.checkpoint("sweep/seed-4").second == run.checkpoint("alone").second);

  const Json joined = json_of(run.folder() / "sweep/sweep.json");
  EXPECT_EQ(joined["seeds"], (std::vector<int>{3, 5, 4}));
  EXPECT_EQ(joined["agent"], "place_filter");
  EXPECT_EQ(joined["learner"], "ppo");
  EXPECT_TRUE(joined["failed"].empty());
  std::vector<double> spl, blind;
  for (const char* seed : {"3", "5", "4"}) {
    const Json summary = json_of(run.folder() / ("sweep/seed-" + std::string(seed) + "/summary.json"));
    EXPECT_EQ(summary["seed"], std::stoi(seed));
    spl.push_back(summary["evaluate"]["summer"]["spl"]);
    blind.push_back(summary["controls"]["blind"]["summer"]["spl"]);
  }
  EXPECT_EQ(joined["evaluate"]["summer"]["spl"]["values"], spl);
  EXPECT_EQ(joined["controls"]["blind"]["summer"]["spl"]["values"], blind);
  std::sort(spl.begin(), spl.end());
  EXPECT_EQ(joined["evaluate"]["summer"]["spl"]["median"], spl[1]);
  EXPECT_EQ(joined["evaluate"]["summer"]["spl"]["max"], spl[2]);
  EXPECT_EQ(joined["train"]["steps"]["median"], 8 * 512);
  EXPECT_TRUE(contains(sweep->output(), "| place_filter | ppo"));

  // The table of the sweep and of the lone run, which walked the tasks of seed 5.
  Service table({CITYLEARN_POLICY_SERVICE, "--mode", "table", run.folder() / "sweep", run.folder() / "alone"},
                run.folder() / "table.log");
  ASSERT_EQ(table.wait(seconds(10)), 0) << table.output();
  EXPECT_TRUE(contains(table.output(), "| alone | place_filter"));
  EXPECT_TRUE(contains(table.output(), "3,5,4"));
}

TEST(Sweep, GoesOnWithTheSeedThatWasInterrupted) {
  Trial run("fastdds");
  const auto summer = run.env("summer");
  constexpr int kUpdates = 150;
  const auto straight = run.train(kUpdates, "straight", {"--seed", "2"});
  ASSERT_EQ(straight->wait(kLongWait), 0) << straight->output();
  const auto interrupted = run.train(kUpdates, "sweep", {"--seeds", "1..3"});
  ASSERT_TRUE(run.has_checkpoint("sweep/seed-2", kLongWait)) << interrupted->output();
  ASSERT_EQ(interrupted->end(SIGTERM, seconds(5)), 130) << interrupted->output();
  ASSERT_TRUE(std::filesystem::exists(run.folder() / "sweep/seed-1/summary.json"));
  ASSERT_FALSE(std::filesystem::exists(run.folder() / "sweep/seed-2/summary.json")) << "it had ended before";
  ASSERT_FALSE(std::filesystem::exists(run.folder() / "sweep/seed-3"));
  const std::string first = contents(run.folder() / "sweep/seed-1/summary.json");

  const auto other = run.train(kUpdates, "sweep", {"--seeds", "1..3", "--resume", "--ppo-gamma", "0.5"});
  EXPECT_EQ(other->wait(seconds(10)), 1) << "seed 1 is of another run";
  EXPECT_TRUE(contains(other->output(), "gamma was "));

  const auto resumed = run.train(kUpdates, "sweep", {"--seeds", "1..3", "--resume"});
  ASSERT_EQ(resumed->wait(kLongWait), 0) << resumed->output();
  EXPECT_TRUE(contains(resumed->output(), "seed 1 is complete"));
  EXPECT_TRUE(contains(resumed->output(), "resuming after update"));
  EXPECT_EQ(contents(run.folder() / "sweep/seed-1/summary.json"), first);
  EXPECT_TRUE(run.checkpoint("sweep/seed-2") == run.checkpoint("straight")) << "the final checkpoints differ";
  EXPECT_EQ(json_of(run.folder() / "sweep/sweep.json")["seeds"], (std::vector<int>{1, 2, 3}));
}

TEST(Sweep, ASeedThatFailsIsNamedAndTheOthersGoOn) {
  Trial run("cyclonedds");
  const auto summer = run.env("summer");
  std::filesystem::create_directories(run.folder() / "out");
  std::ofstream(run.folder() / "out/seed-2") << "in the way";
  const auto sweep = run.train(4, "out", {"--seeds", "1..3"});
  EXPECT_EQ(sweep->wait(kLongWait), 1) << sweep->output();
  EXPECT_TRUE(contains(sweep->output(), "policy_service: seeds: 1 of 3 failed: 2: "));
  const Json joined = json_of(run.folder() / "out/sweep.json");
  EXPECT_EQ(joined["seeds"], (std::vector<int>{1, 3}));
  ASSERT_EQ(joined["failed"].size(), 1u);
  EXPECT_EQ(joined["failed"][0]["seed"], 2);
  // Out of the way, --resume runs it and leaves the others alone.
  std::filesystem::remove(run.folder() / "out/seed-2");
  const auto again = run.train(4, "out", {"--seeds", "1..3", "--resume"});
  EXPECT_EQ(again->wait(kLongWait), 0) << again->output();
  EXPECT_EQ(json_of(run.folder() / "out/sweep.json")["seeds"], (std::vector<int>{1, 2, 3}));
}

TEST(Sweep, WrongInputIsOneClearLine) {
  Trial run("cyclonedds");
  const std::string out = run.folder() / "out";
  const WrongInputs cases = {
      {"no number", {{"--seeds", "1..x", "--output", out}, "'x'"}},
      {"evaluate", {{"--seeds", "1..2", "--output", out, "--mode", "evaluate", "--agent", "blind"}, "--mode train"}},
      {"both", {{"--seeds", "1..2", "--output", out, "--seed", "3"}, "--seed"}},
      {"no output", {{"--seeds", "1..2"}, "--output"}},
      {"unknown agent", {{"--seeds", "1..2", "--output", out, "--agent", "oracle"}, "place_filter"}},
      {"no runs", {{"--mode", "table"}, "summary.json"}},
      {"no such run", {{"--mode", "table", "/nonexistent"}, "/nonexistent"}},
      {"runs without table", {{"runs/today"}, "--mode table"}},
  };
  expect_one_clear_line(run, cases);
}

}  // namespace
}  // namespace citylearn::testing
