// SPDX-License-Identifier: Apache-2.0
// Whole runs: real processes over loopback DDS.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "core/wire/node.h"
#include "tests/paths.h"
#include "tests/support/processes/service.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/episodes_csv.h"
#include "tests/support/records/recorder.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

std::vector<std::string> files_in(const std::string& folder) {
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) files.push_back(entry.path());
  return files;
}

class Vendors : public VendorTest {};
CITYLEARN_EACH_VENDOR(Vendors);

TEST_P(Vendors, TrainEvaluateAndReport) {
  Trial run(GetParam());
  const auto summer = run.env("summer"), fall = run.env("fall");
  const auto policy = run.policy({"--agent", "place_filter", "--steps", "4096", "--output", run.folder() / "out",
                                  "--tasks", "300", "--evaluate", "summer,fall", "--controls", "all", "--seed", "3"});
  ASSERT_EQ(policy->wait(kLong), 0) << policy->output();
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
  const auto events = files_in(run.folder() / "out/tensorboard");
  ASSERT_EQ(events.size(), 1u);
  for (const char* tag : {"Environment/Cumulative Reward", "Environment/Episode Length", "Policy/Entropy"})
    EXPECT_TRUE(contains(contents(events[0]), tag));
}

TEST_P(Vendors, AKilledPolicyServiceGoesOnByteForByte) {
  Trial run(GetParam());
  const auto summer = run.env("summer");
  constexpr int kUpdates = 300;  // some seconds, so that the first checkpoint is far from the end
  const auto straight = run.train(kUpdates, "straight");
  ASSERT_EQ(straight->wait(kLong), 0) << straight->output();
  {
    const auto killed = run.train(100000, "killed", {"--place_filter-nothing"});
    EXPECT_NE(killed->wait(seconds(10)), 0) << "unknown parameters are errors";
  }
  // The schedules follow --steps, so the run to be killed is the same run; it is killed as soon as it has a checkpoint.
  auto killed = run.train(kUpdates, "killed");
  ASSERT_TRUE(run.has_checkpoint("killed", kLong)) << killed->output();
  ASSERT_EQ(killed->end(SIGKILL, seconds(5)), 128 + SIGKILL) << "it had ended before";
  ASSERT_NE(run.checkpoint("killed").first, run.checkpoint("straight").first) << "it had finished training before";
  const auto resumed = run.train(kUpdates, "killed", {"--resume"});
  ASSERT_TRUE(resumed->says("resuming after update", seconds(10))) << "goes on within 10 s\n" << resumed->output();
  ASSERT_EQ(resumed->wait(kLong), 0) << resumed->output();
  const auto expected = run.checkpoint("straight"), found = run.checkpoint("killed");
  EXPECT_EQ(found.first, expected.first);
  EXPECT_TRUE(found.second == expected.second) << "the final checkpoints differ";
  int points = 0;
  for (const std::string& file : files_in(run.folder() / "killed/tensorboard"))
    points += occurrences(contents(file), "Losses/Value Loss");
  EXPECT_EQ(files_in(run.folder() / "killed/tensorboard").size(), 2u) << "one of each process";
  EXPECT_EQ(points, kUpdates) << "one an update, although some were computed twice";
}

/// What is kept for a dashboard that is not there comes to every policy_service too.
TEST_P(Vendors, ALaggingRecorderDisturbsNobodysRecords) {
  Trial run(GetParam());
  const auto summer = run.env("summer", {"--recorders", "dashboard"});
  const auto one = run.train(8, "one");
  ASSERT_EQ(one->wait(kLong), 0) << one->output();
  const auto killed = run.train(200, "two");
  ASSERT_TRUE(run.has_checkpoint("two", kLong)) << killed->output();
  ASSERT_EQ(killed->end(SIGKILL, seconds(5)), 128 + SIGKILL) << "it had ended before";
  const auto resumed = run.train(200, "two", {"--resume"});
  ASSERT_EQ(resumed->wait(kLong), 0) << resumed->output();
  const auto first = in_csv(run.folder() / "one/episodes.csv").begin()->second;
  const auto second = in_csv(run.folder() / "two/episodes.csv").begin()->second;
  ASSERT_FALSE(first.empty());
  EXPECT_EQ(*first.begin(), 1u);
  EXPECT_EQ(*first.rbegin(), first.size());
  EXPECT_GT(*second.begin(), *first.rbegin()) << "those of its predecessor are none of its own";
  EXPECT_EQ(*second.rbegin() - *second.begin() + 1, second.size()) << "none is missing";
  // The dashboard gets all, and knows what belongs together.
  EpisodeStore store;
  Recorder dashboard(run.middleware(), "default", "dashboard", store);
  ASSERT_TRUE(dashboard.until([&] { return dashboard.recorded["env-summer"] >= *second.rbegin(); }));
  const auto job = [&](const std::string& output) {
    return Json::parse(contents(run.folder() / (output + "/manifest.json")))["job"].get<std::uint64_t>();
  };
  for (const auto& [number, stat] : store["env-summer"]) {
    if (first.contains(number)) {
      EXPECT_EQ(stat.run_id(), job("one")) << number;
    } else if (second.contains(number)) {
      EXPECT_EQ(stat.run_id(), job("two")) << number;
    }
    EXPECT_EQ(std::string(stat.policy().c_str()), "place_filter");
  }
}

TEST_P(Vendors, AKilledEnvServiceIsWelcomedBack) {
  Trial run(GetParam());
  auto summer = run.env("summer");
  const auto policy = run.train(600, "out");  // it stands still without its only env_service
  ASSERT_TRUE(run.has_checkpoint("out", kLong)) << policy->output();
  summer->send(SIGKILL);
  summer->wait(seconds(5));
  ASSERT_FALSE(policy->says("trained ", milliseconds(1))) << "it had finished training before";
  summer = run.env("summer");
  ASSERT_TRUE(policy->says("restarted env_service", seconds(10))) << policy->output();
  EXPECT_EQ(policy->wait(kLong), 0) << policy->output();
}

TEST_P(Vendors, SeveralTrainingEnvironmentsOneOfThemLost) {
  Trial run(GetParam());
  auto one = run.env("summer", {"--id", "one"}), two = run.env("summer", {"--id", "two"});
  const auto policy = run.train(600, "out", {"--environments", "2"});  // each update uses both, or the one that is left
  ASSERT_TRUE(run.has_checkpoint("out", kLong)) << policy->output();
  two->send(SIGKILL);
  ASSERT_TRUE(policy->says("goes on without it", seconds(20))) << policy->output();
  EXPECT_EQ(policy->wait(kLong), 0) << policy->output();
}

TEST(Experiences, TrainOnTwoTraversalsThenActOnAThird) {
  Trial run("cyclonedds");
  const auto summer = run.env("summer"), fall = run.env("fall"), winter = run.env("winter");
  std::string bytes[2];
  for (const std::string out : {"out", "again"}) {
    const auto policy =
        run.policy({"--train", "summer,fall", "--evaluate", "winter", "--agent", "place_filter", "--steps", "2048",
                    "--tasks", "50", "--controls", "sequence_filter", "--lockstep", "--output", run.folder() / out});
    ASSERT_EQ(policy->wait(kLong), 0) << policy->output();
    bytes[out == "again"] = run.checkpoint(out).second;
  }
  EXPECT_FALSE(bytes[0].empty());
  EXPECT_TRUE(bytes[0] == bytes[1]) << "the same seed, the same bytes";
  const Json summary = Json::parse(contents(run.folder() / "out/summary.json"));
  EXPECT_EQ(summary["train"]["traversal"], "summer, fall");
  EXPECT_EQ(summary["evaluate"].size(), 1u);
  const std::string path = run.folder() / ("out/checkpoints/" + run.checkpoint("out").first);
  const auto later =
      run.policy({"--mode", "evaluate", "--checkpoint", path, "--train", "summer,fall", "--tasks", "50", "--evaluate",
                  "winter", "--controls", "sequence_filter", "--output", run.folder() / "later"});
  ASSERT_EQ(later->wait(kLong), 0) << later->output();
  const Json again = Json::parse(contents(run.folder() / "later/summary.json"));
  for (const char* part : {"evaluate", "controls"}) EXPECT_EQ(again[part], summary[part]) << part;
  const auto other = run.env("night", {"--synthetic-dimension", "32"});
  const auto refused = run.policy({"--train", "summer,night", "--wait", "20", "--evaluate", "winter"});
  EXPECT_EQ(refused->wait(kLong), 1);
  EXPECT_TRUE(contains(refused->output(), "traversal 'night': has 32 features a frame, 'summer' has"))
      << refused->output();
}

TEST_P(Vendors, SigtermEndsWithinTwoSeconds) {
  Trial run(GetParam());
  const auto waiting = run.policy({"--session", "nobody"});
  ASSERT_TRUE(waiting->says("waiting for env_services", seconds(20))) << waiting->output();
  EXPECT_TRUE(waiting->end(SIGTERM, seconds(2)).has_value());
  const auto summer = run.env("summer");
  const auto policy = run.train(1000000, "out");
  ASSERT_TRUE(run.has_checkpoint("out", kLong)) << policy->output();
  EXPECT_EQ(policy->end(SIGTERM, seconds(2)), 130);
  EXPECT_EQ(summer->end(SIGTERM, seconds(2)), 0);
}

TEST_P(Vendors, AForeignTypeOnATopicIsNamedWithinFiveSeconds) {
  Trial run(GetParam());
  MiddlewareOptions options = run.middleware();
  options.participant = "stranger";
  const auto stranger = create_middleware(options);
  Topic topic = topic_of<msg::Observation>();
  topic.type = "other::Picture";
  const auto publisher = stranger->create_publisher(topic);
  const auto policy = run.policy({});
  EXPECT_EQ(policy->wait(seconds(8)), 1);
  EXPECT_TRUE(contains(policy->output(), "other::Picture"));
  EXPECT_TRUE(contains(policy->output(), "citylearn/observation"));
}

TEST(Lockstep, SameSeedSameBytesOverEveryMiddleware) {
  std::map<std::string, std::string> bytes;
  const std::string lossy = "lossy,drop=0.05,repeat=0.05,reorder=0.05,seed=7:cyclonedds";
  for (const auto& [middleware, observations] : {std::pair<std::string, std::string>{"fastdds", "whole"},
                                                 {"cyclonedds", "whole"},
                                                 {lossy, "whole"},
                                                 {"fastdds", "by_reference"},
                                                 {lossy, "by_reference"}}) {
    Trial run(middleware);
    const auto summer = run.env("summer");
    const auto policy = run.train(30, "out", {"--lockstep", "--seed", "5", "--observations", observations});
    ASSERT_EQ(policy->wait(kLong), 0) << middleware << "\n" << policy->output();
    bytes[middleware + " " + observations] = run.checkpoint("out").second;
  }
  {
    Trial run("inprocess");
    Service both({INPROCESS_RUN, run.folder() / "out"}, run.folder() / "log");
    ASSERT_EQ(both.wait(kLong), 0) << both.output();
    bytes["inprocess"] = run.checkpoint("out").second;
  }
  ASSERT_FALSE(bytes["inprocess"].empty());
  for (const auto& [name, found] : bytes) EXPECT_TRUE(found == bytes["inprocess"]) << name << " differs from inprocess";
  Trial run("cyclonedds");
  const auto summer = run.env("summer");
  const auto policy = run.train(30, "out", {"--lockstep", "--seed", "6"});
  ASSERT_EQ(policy->wait(kLong), 0) << policy->output();
  EXPECT_FALSE(run.checkpoint("out").second == bytes["inprocess"]) << "another seed is another run";
}

/// However many steps it might have done: else it ends at the learning rate that it began with.
TEST(TimeLimit, EndsWhatFallsInTheCourseOfTheRun) {
  Trial run("cyclonedds");
  const auto summer = run.env("summer");
  const auto policy = run.policy({"--agent", "place_filter", "--steps", "1000000000", "--time-limit", "2", "--tasks",
                                  "20", "--output", run.folder() / "out"});
  ASSERT_EQ(policy->wait(kLong), 0) << policy->output();
  const std::string metrics = run.folder() / "out/metrics.csv";
  ASSERT_TRUE(lines_of(contents(metrics)).at(0).ends_with(",learning_rate,policy_lag"));
  std::vector<double> rates;
  for (const auto& row : csv_rows(metrics)) rates.push_back(std::stod(row.at(row.size() - 2)));
  ASSERT_GT(rates.size(), 2u);
  EXPECT_LT(rates.back(), 0.5 * rates.front());
}

TEST(Checkpoint, ActsAgainInEvaluateModeAndRefusesWhatIsNone) {
  Trial run("cyclonedds");
  const auto summer = run.env("summer");
  const auto trained = run.train(4, "out");
  ASSERT_EQ(trained->wait(kLong), 0) << trained->output();
  const auto [name, bytes] = run.checkpoint("out");
  const std::string path = run.folder() / ("out/checkpoints/" + name);
  const auto again = run.policy({"--mode", "evaluate", "--checkpoint", path, "--tasks", "16", "--evaluate", "summer",
                                 "--output", run.folder() / "again"});
  ASSERT_EQ(again->wait(kLong), 0) << again->output();
  EXPECT_EQ(Json::parse(contents(run.folder() / "again/summary.json"))["evaluate"],
            Json::parse(contents(run.folder() / "out/summary.json"))["evaluate"]);
  const std::string episodes = contents(run.folder() / "out/episodes.csv");
  const std::string summary = contents(run.folder() / "out/summary.json");
  const auto into_it = run.policy({"--mode", "evaluate", "--checkpoint", path, "--tasks", "16", "--evaluate", "summer",
                                   "--output", run.folder() / "out"});
  EXPECT_EQ(into_it->wait(kLong), 1) << into_it->output();
  EXPECT_TRUE(contains(into_it->output(), "out/manifest.json: belongs to an earlier run"));
  EXPECT_EQ(contents(run.folder() / "out/episodes.csv"), episodes) << "the training's";
  EXPECT_EQ(contents(run.folder() / "out/summary.json"), summary) << "the training's";
  const std::string damaged = run.folder() / "damaged";
  make_file(damaged, bytes.substr(0, bytes.size() - 7));
  const auto policy = run.policy({"--mode", "evaluate", "--checkpoint", damaged});
  EXPECT_EQ(policy->wait(seconds(10)), 1) << policy->output();
  EXPECT_TRUE(contains(policy->output(), damaged));
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
