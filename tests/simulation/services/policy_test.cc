// SPDX-License-Identifier: Apache-2.0
// Trainings and evaluations whose services are killed, resumed and replaced.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>

#include "dashboard/store/database.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/episodes_csv.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

TEST(Recovery, AKilledPolicyServiceGoesOnByteForByte) {
  Trial run("simulated");
  const auto summer = run.env("summer");
  constexpr int kUpdates = 300;  // some seconds, so that the first checkpoint is far from the end
  const auto straight = run.train(kUpdates, "straight");
  ASSERT_EQ(straight->wait(kLongWait), 0) << straight->output();
  {
    const auto killed = run.train(100000, "killed", {"--place_filter-nothing"});
    EXPECT_NE(killed->wait(seconds(10)), 0) << "unknown parameters are errors";
  }
  // The schedules follow --steps, so the run to be killed is the same run; it is killed as soon as it has a checkpoint.
  auto killed = run.train(kUpdates, "killed");
  ASSERT_TRUE(run.has_checkpoint("killed", kLongWait)) << killed->output();
  ASSERT_EQ(killed->end(SIGKILL, seconds(5)), 128 + SIGKILL) << "it had ended before";
  ASSERT_NE(run.checkpoint("killed").first, run.checkpoint("straight").first) << "it had finished training before";
  const auto resumed = run.train(kUpdates, "killed", {"--resume"});
  ASSERT_TRUE(resumed->says("resuming after update", seconds(10))) << "goes on within 10 s\n" << resumed->output();
  ASSERT_EQ(resumed->wait(kLongWait), 0) << resumed->output();
  const auto expected = run.checkpoint("straight"), found = run.checkpoint("killed");
  EXPECT_EQ(found.first, expected.first);
  EXPECT_TRUE(found.second == expected.second) << "the final checkpoints differ";
  int points = 0;
  for (const std::string& file : paths_in(run.folder() / "killed/tensorboard"))
    points += occurrences(contents(file), "Losses/Value Loss");
  EXPECT_EQ(paths_in(run.folder() / "killed/tensorboard").size(), 2u) << "one of each process";
  EXPECT_EQ(points, kUpdates) << "one an update, although some were computed twice";
}

/// Episodes that are kept for an absent dashboard come to every policy_service, too.
TEST(Recovery, ALaggingRecorderDisturbsNobodysRecords) {
  Trial run("simulated");
  const auto summer = run.env("summer", {"--recorders", "dashboard", "--linger", "60"});
  const auto one = run.train(8, "one");
  ASSERT_EQ(one->wait(kLongWait), 0) << one->output();
  const auto killed = run.train(200, "two");
  ASSERT_TRUE(run.has_checkpoint("two", kLongWait)) << killed->output();
  ASSERT_EQ(killed->end(SIGKILL, seconds(5)), 128 + SIGKILL) << "it had ended before";
  const auto resumed = run.train(200, "two", {"--resume"});
  ASSERT_EQ(resumed->wait(kLongWait), 0) << resumed->output();
  const auto first = in_csv(run.folder() / "one/episodes.csv").begin()->second;
  const auto second = in_csv(run.folder() / "two/episodes.csv").begin()->second;
  ASSERT_FALSE(first.empty());
  EXPECT_EQ(*first.begin(), 1u);
  EXPECT_EQ(*first.rbegin(), first.size());
  EXPECT_GT(*second.begin(), *first.rbegin()) << "those of its predecessor are none of its own";
  EXPECT_EQ(*second.rbegin() - *second.begin() + 1, second.size()) << "none is missing";
  // The dashboard gets all, and knows what belongs together.
  const std::string store = run.folder() / "dashboard.sqlite";
  const auto dashboard = run.recorder(store);
  ASSERT_EQ(summer->end(SIGTERM, kLongWait), 0) << summer->output();
  ASSERT_EQ(dashboard->end(SIGTERM, kLongWait), 0) << dashboard->output();
  SQLite::Database database = open_database(store);
  SQLite::Statement rows(database, "SELECT episode, run_id FROM episodes WHERE policy = 'place_filter'");
  std::map<std::int64_t, std::set<std::uint64_t>> stored;  // episodes, by job
  while (rows.executeStep())
    stored[rows.getColumn(1).getInt64()].insert(static_cast<std::uint64_t>(rows.getColumn(0).getInt64()));
  const auto of_job = [&](const std::string& output) {
    return stored[Json::parse(contents(run.folder() / (output + "/manifest.json")))["job"].get<std::int64_t>()];
  };
  EXPECT_TRUE(std::ranges::includes(of_job("one"), first));
  EXPECT_TRUE(std::ranges::includes(of_job("two"), second));
}

/// A run that ends lets its env_services drop what it did not get, so it does not end before it has what it knows of.
TEST(Recovery, ARunEndsWithTheEpisodesThatDidNotArriveAtOnce) {
  for (const std::string seed : {"1", "2", "3", "4"}) {
    Trial run("simulated");
    const auto summer =
        run.env("summer", {"--middleware", "lossy,drop=0.3,repeat=0,reorder=0,seed=" + seed + ":simulated"});
    const auto policy = run.train(4, "out");
    ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
    std::set<std::string> tasks;  // of the evaluation, whose summary needs them all
    for (const auto& row : csv_rows(run.folder() / "out/episodes.csv"))
      if (row.at(5) == "1") tasks.insert(row.at(6));
    EXPECT_EQ(tasks.size(), 16u) << "seed " << seed << "\n" << policy->output();
  }
}

TEST(Recovery, SeveralTrainingEnvironmentsOneOfThemLost) {
  Trial run("simulated");
  auto one = run.env("summer", {"--id", "one"}), two = run.env("summer", {"--id", "two"});
  const auto policy = run.train(600, "out", {"--environments", "2"});  // each update uses both, or the one that is left
  ASSERT_TRUE(run.has_checkpoint("out", kLongWait)) << policy->output();
  two->send(SIGKILL);
  ASSERT_TRUE(policy->says("goes on without it", seconds(20))) << policy->output();
  EXPECT_EQ(policy->wait(kLongWait), 0) << policy->output();
}

TEST(Recovery, ATrainingBeginsWithAllItsEnvServices) {
  Trial run("simulated");
  const auto one = run.env("summer", {"--id", "one"}), two = run.env("summer", {"--id", "two"});
  ASSERT_TRUE(two->says("'two' in session", kLongWait)) << two->output();
  one->send(SIGSTOP);  // it is asked for its features first, and goes silent meanwhile
  const auto policy = run.train(4, "out", {"--environments", "2", "--lockstep"});
  ASSERT_TRUE(policy->says("'one' joins", kLongWait)) << policy->output();
  ASSERT_TRUE(policy->says("waiting for env_services on summer (1 of 2)", kLongWait)) << policy->output();
  EXPECT_FALSE(two->output().find("settings 1 of") != std::string::npos) << two->output();
  one->send(SIGCONT);
  ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
  for (const auto* env : {one.get(), two.get()}) EXPECT_TRUE(contains(env->output(), ": training")) << env->output();
}

TEST(Experiences, TrainOnTwoTraversalsThenActOnAThird) {
  Trial run("simulated");
  const auto summer = run.env("summer"), fall = run.env("fall"), winter = run.env("winter");
  std::string bytes[2];
  for (const std::string out : {"out", "again"}) {
    const auto policy =
        run.policy({"--train", "summer,fall", "--evaluate", "winter", "--agent", "place_filter", "--steps", "2048",
                    "--tasks", "50", "--controls", "sequence_filter", "--lockstep", "--output", run.folder() / out});
    ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
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
  ASSERT_EQ(later->wait(kLongWait), 0) << later->output();
  const Json again = Json::parse(contents(run.folder() / "later/summary.json"));
  for (const char* part : {"evaluate", "controls"}) EXPECT_EQ(again[part], summary[part]) << part;
  const auto other = run.env("night", {"--synthetic-dimension", "32"});
  const auto refused = run.policy({"--train", "summer,night", "--wait", "20", "--evaluate", "winter"});
  EXPECT_EQ(refused->wait(kLongWait), 1);
  EXPECT_TRUE(contains(refused->output(), "traversal 'night': has 32 features a frame, 'summer' has"))
      << refused->output();
}

/// However many steps it might have done: else it ends at the learning rate that it began with.
TEST(TimeLimit, EndsWhatFallsInTheCourseOfTheRun) {
  Trial run("simulated");
  const auto summer = run.env("summer");
  const auto policy = run.policy({"--agent", "place_filter", "--steps", "1000000000", "--time-limit", "2", "--tasks",
                                  "20", "--output", run.folder() / "out"});
  ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
  const std::string metrics = run.folder() / "out/metrics.csv";
  ASSERT_TRUE(lines_of(contents(metrics)).at(0).ends_with(",learning_rate,policy_lag"));
  std::vector<double> rates;
  for (const auto& row : csv_rows(metrics)) rates.push_back(std::stod(row.at(row.size() - 2)));
  ASSERT_GT(rates.size(), 2u);
  EXPECT_LT(rates.back(), 0.5 * rates.front());
}

/// Nothing is lost of a training that is stopped between two checkpoints.
TEST(Stopping, ASignalSavesTheLastUpdate) {
  Trial run("simulated");
  const auto early = run.train(100000, "early");
  ASSERT_TRUE(early->says("waiting for env_services", kLongWait)) << early->output();
  EXPECT_EQ(early->end(SIGTERM, seconds(2)), 130);
  EXPECT_TRUE(contains(early->output(), "there is no checkpoint yet to resume from")) << early->output();

  const auto summer = run.env("summer");
  const std::string metrics = run.folder() / "out/metrics.csv";
  const auto trained = run.train(100000, "out", {"--checkpoint-every", "1000000"});
  ASSERT_TRUE(poll_until([&] { return csv_rows(metrics).size() > 3; }, kLongWait)) << trained->output();
  EXPECT_EQ(trained->end(SIGINT, seconds(2)), 130);
  const std::string last = csv_rows(metrics).back().at(0);
  EXPECT_TRUE(contains(trained->output(), "--resume continues after update " + last + "\n")) << trained->output();
  const auto resumed = run.train(100000, "out", {"--checkpoint-every", "1000000", "--resume"});
  EXPECT_TRUE(resumed->says("resuming after update " + last + " ", kLongWait)) << resumed->output();
  ASSERT_TRUE(poll_until([&] { return csv_rows(metrics).size() > std::stoul(last) + 3; }, kLongWait))
      << resumed->output();
  EXPECT_EQ(resumed->end(SIGINT, seconds(2)), 130);
}

/// Four env_services divide the tasks; what comes out is what one alone does, also when one of the four is killed.
TEST(Evaluation, IsTheSameByAnyEnvServices) {
  Trial run("simulated");
  std::string path;
  {
    const auto summer = run.env("summer");
    const auto trained = run.train(40, "trained");
    ASSERT_EQ(trained->wait(kLongWait), 0) << trained->output();
    path = run.folder() / ("trained/checkpoints/" + run.checkpoint("trained").first);
  }
  constexpr int kTasks = 400;
  const auto evaluate = [&](const std::string& output) {
    return run.policy({"--mode", "evaluate", "--checkpoint", path, "--tasks", std::to_string(kTasks), "--evaluate",
                       "winter", "--train", "winter", "--controls", "sequence_filter", "--output",
                       run.folder() / output});
  };
  // Of the agent and the control together, by env_service.
  const auto tasks = [&](const std::string& output) {
    std::map<std::string, int> done;
    for (const auto& row : csv_rows(run.folder() / (output + "/episodes.csv"))) ++done[row.at(0)];
    return done;
  };
  const auto scores = [&](const std::string& output) {
    const Json summary = Json::parse(contents(run.folder() / (output + "/summary.json")));
    return summary["evaluate"].dump() + summary["controls"].dump();
  };
  {
    const auto one = run.env("winter", {"--id", "alone", "--agents", "3"});
    const auto policy = evaluate("alone");
    ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
    EXPECT_EQ(tasks("alone")["alone"], 2 * kTasks);
  }
  {
    const auto one = run.env("winter", {"--id", "many", "--agents", "3", "--evaluation-agents", "200"});
    const auto policy = evaluate("many");
    ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
    EXPECT_EQ(scores("many"), scores("alone"));
  }
  std::vector<std::unique_ptr<Service>> four;
  for (const std::string id : {"a", "b", "c", "d"}) {
    four.push_back(run.env("winter", {"--id", id}));
    ASSERT_TRUE(four.back()->says("'" + id + "' in session", kLongWait)) << four.back()->output();
  }
  // First, while no env_service has said yet what is waited for.
  const auto broken = evaluate("broken");
  ASSERT_TRUE(four[1]->says("evaluation tasks 160..", kLongWait)) << four[1]->output();
  ASSERT_EQ(four[1]->end(SIGKILL, seconds(5)), 128 + SIGKILL);
  ASSERT_EQ(broken->wait(kLongWait), 0) << broken->output();
  EXPECT_TRUE(contains(broken->output(), "others evaluate")) << broken->output();
  EXPECT_EQ(scores("broken"), scores("alone"));

  four[1] = run.env("winter", {"--id", "b"});
  ASSERT_TRUE(four[1]->says("'b' in session", kLongWait)) << four[1]->output();
  const auto together = evaluate("together");
  ASSERT_EQ(together->wait(kLongWait), 0) << together->output();
  EXPECT_EQ(scores("together"), scores("alone"));
  const int half = kTasks / 2;
  for (const auto& [id, done] : tasks("together")) EXPECT_NEAR(done, half, 16) << id;
}

/// By other frames, another encoder or another reduction an agent would only seem to have learned badly.
TEST(Checkpoint, KnowsItsDataAndRefusesOthers) {
  Trial run("simulated");
  std::string path;
  {
    const auto summer = run.env("summer");
    const auto trained = run.train(4, "out", {"--source", "data=/drives", "--source", "synthetic-images=0"});
    ASSERT_EQ(trained->wait(kLongWait), 0) << trained->output();
    path = run.folder() / ("out/checkpoints/" + run.checkpoint("out").first);
  }
  const auto evaluate = [&](const std::string& traversal, const std::string& file, const Arguments& more = {}) {
    return run.policy(Arguments{"--mode", "evaluate", "--checkpoint", file, "--tasks", "16", "--evaluate", traversal} +
                      more);
  };
  {
    const auto other = run.env("summer", {"--frames", "0:140", "--id", "short"});
    const auto refused = evaluate("summer", path);
    EXPECT_EQ(refused->wait(kLongWait), 1) << refused->output();
    const std::regex line("policy_service: env_service 'short' on 'summer', for " + path +
                          ": has other contents \\(140 frames, hash [0-9a-f]{16}\\) than the training \\(160 frames, "
                          "hash [0-9a-f]{16}\\) \\(take the data and the encoder of the training: --data /drives "
                          "--synthetic-images 0\\)\n");
    EXPECT_TRUE(std::regex_search(refused->output(), line)) << refused->output();
    // Checkpoints of earlier versions say nothing.
    Checkpoint old = read_checkpoint(path);
    ASSERT_EQ(old.header.erase("data"), 1u);
    write_checkpoint(run.folder() / "old.clk", old);
    const auto unchecked = evaluate("summer", run.folder() / "old.clk");
    EXPECT_EQ(unchecked->wait(kLongWait), 0) << unchecked->output();
    EXPECT_EQ(occurrences(unchecked->output(), "does not say what its agent learned from"), 1) << unchecked->output();
  }
  const auto winter = run.env("winter", {"--frames", "0:140"});
  const auto elsewhere = evaluate("winter", path, {"--controls", "sequence_filter"});
  EXPECT_EQ(elsewhere->wait(kLongWait), 0) << elsewhere->output();
  EXPECT_TRUE(contains(elsewhere->output(), "place  sequence")) << "it remembers what the agent does";
}

}  // namespace
}  // namespace citylearn::testing
