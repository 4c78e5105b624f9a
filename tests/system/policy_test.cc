// SPDX-License-Identifier: Apache-2.0
// Whole runs: real processes over loopback DDS.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>

#include "core/wire/node.h"
#include "tests/paths.h"
#include "tests/support/processes/hosts.h"
#include "tests/support/processes/service.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/episodes_csv.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

class Vendors : public VendorTest {};
CITYLEARN_EACH_VENDOR(Vendors);

TEST_P(Vendors, TrainEvaluateAndReport) {
  Trial run(GetParam());
  const auto summer = run.env("summer"), fall = run.env("fall");
  const auto policy = run.policy({"--agent", "place_filter", "--steps", "4096", "--output", run.folder() / "out",
                                  "--tasks", "300", "--evaluate", "summer,fall", "--controls", "all", "--seed", "3"});
  ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
  const Json summary = Json::parse(contents(run.folder() / "out/summary.json"));
  EXPECT_EQ(summary["agent"], "place_filter");
  EXPECT_EQ(summary["middleware"], GetParam());
  EXPECT_EQ(summary["seed"], 3);
  EXPECT_EQ(summary["train"]["traversal"], "summer");
  EXPECT_EQ(summary["train"]["steps"], 4096);
  for (const char* key : {"episodes", "wall_s", "steps_per_s", "reward", "episodes_to_spl95", "wall_s_to_spl95"})
    EXPECT_TRUE(summary["train"].contains(key)) << key;
  ASSERT_EQ(summary["evaluate"].size(), 2u);
  for (const auto& [name, score] : summary["evaluate"].items()) {
    EXPECT_EQ(score["tasks"], 300) << name;
    for (const char* key : {"completed", "spl", "excess", "mean_steps", "shortest_mean", "reward"})
      EXPECT_TRUE(score[key].is_number()) << key;
  }
  ASSERT_EQ(summary["controls"].size(), 5u);
  const Json& controls = summary["controls"];
  EXPECT_EQ(controls["shortest_path"]["summer"]["spl"], 1.0);
  EXPECT_EQ(controls["blind"]["fall"]["completed"], 1.0);
  EXPECT_NEAR(controls["blind"]["fall"]["spl"], 0.852, 0.04);
  EXPECT_GT(controls["sequence_filter"]["fall"]["spl"], 0.95);
  EXPECT_EQ(controls["oracle_filter"]["summer"], controls["sequence_filter"]["summer"]) << "both know summer";
  EXPECT_GE(controls["oracle_filter"]["fall"]["spl"], controls["sequence_filter"]["fall"]["spl"]);
  EXPECT_EQ(controls["blind"]["summer"], controls["blind"]["fall"]) << "a blind policy on the same tasks";
  // Every episode of the evaluations is on record, once.
  const std::string log = run.folder() / "out/episodes.csv";
  EXPECT_EQ(occurrences(contents(log), ",fall,1,"), 6 * 300);
  in_csv(log);
  EXPECT_TRUE(Json::parse(contents(run.folder() / "out/manifest.json"))["traversals"].contains("summer"));
  EXPECT_TRUE(contains(policy->output(), "SPL")) << "the final table";
  const auto events = paths_in(run.folder() / "out/tensorboard");
  ASSERT_EQ(events.size(), 1u);
  for (const char* tag : {"Environment/Cumulative Reward", "Environment/Episode Length", "Policy/Entropy"})
    EXPECT_TRUE(contains(contents(events[0]), tag));
}

TEST_P(Vendors, SigtermEndsWithinTwoSeconds) {
  Trial run(GetParam());
  const auto waiting = run.policy({"--session", "nobody"});
  ASSERT_TRUE(waiting->says("waiting for env_services", seconds(20))) << waiting->output();
  EXPECT_TRUE(waiting->end(SIGTERM, seconds(2)).has_value());
  const auto summer = run.env("summer");
  const auto policy = run.train(1000000, "out");
  ASSERT_TRUE(run.has_checkpoint("out", kLongWait)) << policy->output();
  EXPECT_EQ(policy->end(SIGTERM, seconds(2)), 130);
  EXPECT_EQ(summer->end(SIGTERM, seconds(2)), 0);
}

// A bar does not end its line, so a line of the log takes its place.
TEST(Terminal, LogLinesReplaceTheProgressBar) {
  if (std::system("script -qec true /dev/null > /dev/null 2>&1") != 0) GTEST_SKIP() << "there are no terminals here";
  Trial run("cyclonedds");
  const auto summer = run.env("summer");
  const std::string command = std::string(CITYLEARN_POLICY_SERVICE) + " --agent place_filter --steps 40000 --tasks 16" +
                              " --evaluate summer --wait 60 --middleware cyclonedds --domain " +
                              std::to_string(run.domain()) + " --output " + (run.folder() / "out");
  const std::string output = shell("script -qefc '" + command + "' /dev/null 2>&1");
  const std::regex line("\r\x1b\\[K[0-9]{2}:[0-9]{2}:[0-9]{2}\\.");
  const auto lines = std::distance(std::sregex_iterator(output.begin(), output.end(), line), std::sregex_iterator());
  EXPECT_GT(lines, 1) << output;
  EXPECT_EQ(lines, occurrences(output, "[policy_service] ")) << output;
  EXPECT_TRUE(contains(output, "\r\033[Ktraining place_filter")) << output;
  EXPECT_FALSE(contains(output, "nan")) << output;
}

TEST_P(Vendors, AForeignTypeOnATopicIsNamedWithinFiveSeconds) {
  Trial run(GetParam());
  MiddlewareOptions options = run.middleware();
  options.participant = "stranger";
  const auto stranger = create_middleware(options);
  Topic topic = topic_of<msg::TraversalInfo>();
  topic.type = "other::Picture";
  const auto publisher = stranger->create_publisher(topic);
  const auto policy = run.policy({});
  EXPECT_EQ(policy->wait(seconds(8)), 1);
  EXPECT_TRUE(contains(policy->output(), "other::Picture"));
  EXPECT_TRUE(contains(policy->output(), "citylearn/traversal_info"));
}

TEST(Lockstep, SameSeedSameBytesOverEveryMiddleware) {
  std::map<std::string, std::string> bytes;
  for (const auto& [middleware, observations] : {std::pair<std::string, std::string>{"fastdds", "whole"},
                                                 {"cyclonedds", "whole"},
                                                 {"fastdds", "by_reference"}}) {
    Trial run(middleware);
    const auto summer = run.env("summer");
    const auto policy = run.train(30, "out", {"--lockstep", "--seed", "5", "--observations", observations});
    ASSERT_EQ(policy->wait(kLongWait), 0) << middleware << "\n" << policy->output();
    bytes[middleware + " " + observations] = run.checkpoint("out").second;
  }
  {
    Trial run("inprocess");
    Service both({INPROCESS_RUN, run.folder() / "out"}, run.folder() / "log");
    ASSERT_EQ(both.wait(kLongWait), 0) << both.output();
    bytes["inprocess"] = run.checkpoint("out").second;
  }
  ASSERT_FALSE(bytes["inprocess"].empty());
  for (const auto& [name, found] : bytes) EXPECT_TRUE(found == bytes["inprocess"]) << name << " differs from inprocess";
  Trial run("cyclonedds");
  const auto summer = run.env("summer");
  const auto policy = run.train(30, "out", {"--lockstep", "--seed", "6"});
  ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
  EXPECT_FALSE(run.checkpoint("out").second == bytes["inprocess"]) << "another seed is another run";
}

TEST(CommandLine, WrongInputIsOneClearLine) {
  Trial run("cyclonedds");
  std::filesystem::create_directories(run.folder() / "used" + "/checkpoints");
  std::ofstream(run.folder() / "used" + "/checkpoints/checkpoint-7.clk") << "of yesterday";
  const WrongInputs cases = {
      {"output of an earlier run",
       {{"--output", run.folder() / "used"}, "checkpoint-7.clk: belongs to an earlier run"}},
      {"unknown middleware", {{"--middleware", "zeromq"}, "cyclonedds"}},
      {"negative time limit", {{"--time-limit", "-1"}, "--time-limit: '-1' must be 0 or more (try --help)"}},
      {"never a checkpoint", {{"--checkpoint-every", "0"}, "--checkpoint-every: '0' must be 1 or more (try --help)"}},
      {"domain out of range", {{"--domain", "300"}, "domain"}},
      {"no thread", {{"--threads", "0"}, "--threads"}},
      {"fewer threads than none", {{"--threads", "-1"}, "--threads"}},
      {"threads in words", {{"--threads", "x"}, "--threads"}},
      {"more threads than any machine", {{"--threads", "100000"}, "--threads: Value 100000 not in range"}},
      {"no shard", {{"--ppo-shards", "0"}, "shards"}},
      {"two words as id", {{"--id", "my policy"}, "--id: 'my policy' must be 1 to 64 of the characters"}},
      {"a comma in a session", {{"--session", "a,b"}, "--session: 'a,b' must be 1 to 64 of the characters"}},
      {"unknown agent", {{"--agent", "oracle"}, "place_filter"}},
      {"unknown learner", {{"--learner", "sarsa"}, "ppo"}},
      {"unknown control", {{"--controls", "drunk"}, "blind"}},
      {"unknown option", {{"--speed", "9"}, "--speed"}},
      {"parameter out of range", {{"--ppo-gamma", "1.5"}, "gamma"}},
      {"nobody there", {{"--wait", "1"}, "summer"}},
      {"missing checkpoint", {{"--mode", "evaluate", "--checkpoint", "/nonexistent/file"}, "/nonexistent/file"}},
      {"output is a file", {{"--output", "/dev/null/x"}, "/dev/null/x"}},
      {"unknown interface", {{"--interface", "nowhere0"}, "nowhere0"}},
  };
  expect_one_clear_line(run, cases);
  std::ofstream(run.folder() / "wrong.toml") << "agent = \"baseline\"\ncolour = 3\n";
  const auto policy = run.policy({"--config", run.folder() / "wrong.toml"});
  EXPECT_EQ(policy->wait(seconds(8)), 2);
  EXPECT_TRUE(contains(policy->output(), "colour"));
}

TEST(CommandLine, ListNamesEveryPlugin) {
  Folder folder;
  Service list({CITYLEARN_POLICY_SERVICE, "--list"}, folder / "log");
  ASSERT_EQ(list.wait(seconds(10)), 0);
  for (const char* name : {"baseline", "features", "place_filter", "ppo", "blind", "sequence_filter", "shortest_path",
                           "fastdds", "cyclonedds", "inprocess", "--ppo-gamma"})
    EXPECT_TRUE(contains(list.output(), name));
}

}  // namespace
}  // namespace citylearn::testing
