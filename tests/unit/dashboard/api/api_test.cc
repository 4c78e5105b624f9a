// SPDX-License-Identifier: Apache-2.0
// The dashboard's REST API: the shapes of docs/reference/dashboard-api.md.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "dashboard/store/database.h"
#include "tests/support/streets.h"
#include "tests/unit/dashboard/api/api_fixture.h"

namespace citylearn::testing {
namespace {

TEST_F(ApiTest, Runs) {
  EXPECT_EQ(json({"runs"}).dump(), R"({"runs":[]})");
  store_.record(run_info());
  store_.record(std::vector{episode(1, "env-summer", 7, kJob + 9)});
  Json runs = json({"runs"})["runs"];
  ASSERT_EQ(runs.size(), 2u);
  EXPECT_EQ(runs[0]["id"], "demo") << "the newest first";
  EXPECT_EQ(runs[0]["policy"], nullptr);
  EXPECT_EQ(runs[0]["seed"], nullptr);
  const Json& run = runs[1];
  expect_row(run, "run");
  EXPECT_EQ(run["id"], "demo/policy/1/1700000000000000");
  EXPECT_EQ(run["state"], "running");
  EXPECT_EQ(run["reward"], nullptr) << "unknown";
  store_.record(training_stats(1, 4));
  store_.record(ended(run_info(6, 500, 2)));
  const Json ended = json({"runs", id_});
  EXPECT_EQ(ended["state"], "ended");
  EXPECT_EQ(ended["updates"], 6);
  EXPECT_EQ(ended["steps"], 2048);
  EXPECT_EQ(ended["episodes"], 40);
  EXPECT_EQ(ended["reward"], 0.5);
  EXPECT_EQ(ended["spl"], 0.8) << "a float as it was meant";
  EXPECT_EQ(ended["manifest"]["frames"], 128);
}

TEST_F(ApiRunTest, ARunNobodyHearsOfIsLost) {
  options_.silence = -1;
  Api impatient(options_, store_, nullptr);
  EXPECT_EQ(impatient.runs()["runs"][0]["state"], "lost");
}

TEST_F(ApiRunTest, ARunsTraversals) {
  store_.describe(traversal_info());
  store_.describe(traversal_info("env-summer", 8));
  store_.describe(traversal_info("env-of-others", 8));
  store_.record(std::vector{episode(1), episode(1, "env-summer", 8)});
  const Json summer = Json::parse(R"({"environment":"env-summer","dataset":"synthetic","traversal":"summer",
      "condition":"summer","hash":"fedcba9876543210","frames":160,"agents":16,"images":false,"streets":false})");
  const Json running = json({"runs", id_})["traversals"];
  ASSERT_EQ(running.size(), 2u) << "also what it may be evaluated on";
  EXPECT_EQ(running[0], summer) << "as its episodes knew it";
  expect_row(running[0], "traversal");
  EXPECT_EQ(running[1]["environment"], "env-fall");
  store_.record(ended(run_info(0, 500, 2)));
  EXPECT_EQ(json({"runs", id_})["traversals"], Json::array({summer})) << "what its episodes were on";
}

TEST_F(ApiRunTest, TrainingWhole) {
  store_.record(training_stats(1, 20));
  const Json all = json({"runs", id_, "training"}, {{"columns", "reward,spl,policy_lag"}, {"x", "steps"}});
  EXPECT_EQ(sorted(keys(all)), sorted({"id", "x", "total", "columns", "decimated"}));
  EXPECT_EQ(all["id"], id_);
  EXPECT_EQ(all["x"], "steps");
  EXPECT_EQ(all["total"], 20);
  EXPECT_EQ(all["decimated"], false);
  EXPECT_EQ(sorted(keys(all["columns"])), sorted({"x", "reward", "spl", "policy_lag"}));
  EXPECT_EQ(all["columns"]["x"][19], 512 * 20);
  EXPECT_EQ(all["columns"]["spl"][0], nullptr) << "before the first 100 episodes";
  EXPECT_EQ(all["columns"]["spl"][1], 0.8);
  const Json part = json({"runs", id_, "training"}, {{"x", "wall"}, {"from", "2"}, {"to", "3"}});
  EXPECT_EQ(part["columns"]["x"], Json::parse("[2.0,2.25,2.5,2.75,3.0]"));
}

TEST_F(ApiRunTest, TrainingDecimatedLosesNoPeak) {
  std::vector<msg::TrainingStat> stats = training_stats(1, 30'000);
  std::mt19937 random(1);
  for (msg::TrainingStat& stat : stats) stat.reward(static_cast<float>(random() % 1000) / 1000);
  stats[12'344].reward(9);
  stats[23'455].reward(-9);
  stats[17'000].entropy(77);
  store_.record(stats);
  const Json all = json({"runs", id_, "training"}, {{"columns", "reward,entropy"}, {"points", "100"}});
  EXPECT_EQ(all["total"], 30'000);
  EXPECT_EQ(all["decimated"], true);
  const std::vector<double> x = all["columns"]["x"], reward = all["columns"]["reward"];
  EXPECT_LE(x.size(), 100u);
  EXPECT_GE(x.size(), 40u);
  EXPECT_TRUE(std::is_sorted(x.begin(), x.end()));
  EXPECT_EQ(std::adjacent_find(x.begin(), x.end()), x.end()) << "no row twice";
  EXPECT_EQ(x.front(), 1);
  EXPECT_EQ(x.back(), 30'000);
  EXPECT_EQ(*std::max_element(reward.begin(), reward.end()), 9);
  EXPECT_EQ(*std::min_element(reward.begin(), reward.end()), -9);
  EXPECT_NE(std::find(x.begin(), x.end(), 12'345.0), x.end());
  EXPECT_NE(std::find(x.begin(), x.end(), 17'001.0), x.end());
  // In a part of it there is more to be seen.
  const Json part =
      json({"runs", id_, "training"}, {{"columns", "reward"}, {"points", "100"}, {"from", "12001"}, {"to", "12050"}});
  EXPECT_EQ(part["total"], 50);
  EXPECT_EQ(part["decimated"], false);
  // All columns at once in few points.
  std::string every;
  for (const TrainingFigure& column : training_figures())
    every += (every.empty() ? "" : ",") + std::string(column.name);
  EXPECT_LE(json({"runs", id_, "training"}, {{"columns", every}, {"points", "10"}})["columns"]["x"].size(), 10u);
}

TEST_F(ApiRunTest, Episodes) {
  std::vector<msg::EpisodeStat> all = episodes(1, 10);
  for (std::uint64_t i = 0; i < 6; ++i)
    all.push_back(task(11 + i, static_cast<std::uint32_t>(i), i % 2 == 0, 40 + static_cast<std::uint32_t>(i)));
  all.back().shuffled(true);
  store_.record(all);
  const std::vector<std::string> path = {"runs", id_, "episodes"};
  const Json newest = json(path, {{"limit", "3"}});
  EXPECT_EQ(newest["total"], 16);
  ASSERT_EQ(newest["episodes"].size(), 3u);
  const Json& e = newest["episodes"][0];
  expect_row(e, "episode");
  EXPECT_EQ(e["episode"], 16);
  EXPECT_EQ(e["evaluation"], true);
  EXPECT_EQ(e["completed"], false);
  EXPECT_EQ(e["steps"], 128);
  EXPECT_EQ(e["spl"], 0.0);
  const Json next = json(path, {{"limit", "3"}, {"before", newest["episodes"][2]["rowid"].dump()}});
  EXPECT_EQ(next["episodes"][0]["episode"], 13);
  EXPECT_EQ(next["total"], 16);
  EXPECT_EQ(json(path, {{"evaluation", "1"}})["total"], 6);
  EXPECT_EQ(json(path, {{"evaluation", "0"}, {"update", "3"}})["total"], 10);
  EXPECT_EQ(json(path, {{"update", "4"}})["total"], 0);
  EXPECT_EQ(json(path, {{"completed", "0"}})["total"], 3);
  EXPECT_EQ(json(path, {{"shuffled", "1"}})["total"], 1);
  EXPECT_EQ(json(path, {{"shuffled", "0"}})["total"], 15);
  EXPECT_EQ(json(path, {{"traversal", "winter"}})["total"], 0);
  EXPECT_EQ(json(path, {{"policy", "place_filter"}})["total"], 16);
  std::vector<std::uint64_t> order;
  const Json worst = json(path, {{"evaluation", "1"}, {"order", "worst"}});
  for (const Json& one : worst["episodes"]) order.push_back(one["task"].get<std::uint64_t>());
  EXPECT_EQ(order, (std::vector<std::uint64_t>{1, 3, 5, 4, 2, 0}));
}

TEST_F(ApiRunTest, AnEpisodeOnStreetsStepByStep) {
  const StreetMap streets = small_streets();
  msg::TraversalInfo hosted = traversal_info();
  hosted.rule(msg::STREET);
  hosted.frames(13);
  hosted.streets_hash(streets.hash());
  store_.describe(hosted);
  msg::EpisodeStat walk = episode(1);
  walk.start(0);
  walk.steps(3);
  walk.path({0b00'01'01});  // forward, forward, left
  store_.record(std::vector{walk});
  EXPECT_EQ(json({"episodes", "1"})["positions"], nullptr) << "nobody knows the streets";
  EXPECT_EQ(json({"runs", id_})["traversals"][0]["streets"], true);
  RouteMap map;
  map.frames = 13;
  map.streets = std::make_shared<const StreetMap>(streets);
  map.rule = StateRule::kStreet;
  ASSERT_TRUE(RouteStore(store_).keep(hosted.hash(), map));
  EXPECT_EQ(json({"episodes", "1"})["positions"], Json::parse("[0,2,5,4]"));
  const Json shown = json({"map", "fedcba9876543210"});
  expect_row(shown, "map");
  EXPECT_EQ(shown["frames"], 13);
  EXPECT_EQ(shown["streets"]["east"][3], 30.0);
  EXPECT_EQ(shown["streets"]["place"], Json(streets.from));
  EXPECT_EQ(shown["streets"]["heading"][2], 90.0);
}

TEST_F(ApiTest, AnEpisodeStepByStep) {
  store_.describe(traversal_info());
  msg::EpisodeStat without = episode(2);
  without.path({});
  store_.record(std::vector{episode(1), without});
  Json e = json({"episodes", "1"});
  EXPECT_EQ(e["positions"], Json::parse("[1,2,1,2,3,4,5,6]"));
  EXPECT_EQ(e["hash"], "fedcba9876543210");
  e.erase("positions");
  e.erase("hash");
  expect_row(e, "episode");
  EXPECT_EQ(json({"episodes", "2"})["positions"], nullptr);
  expect_error(404, "episode 3 not found", {"episodes", "3"});
  expect_error(400, "'x'", {"episodes", "x"});
  expect_error(400, "rowid", {"episodes", "99999999999999999999"});
}

TEST_F(ApiRunTest, Evaluations) {
  std::vector<msg::EpisodeStat> all;
  for (std::uint32_t i = 0; i < 400; ++i) all.push_back(task(1 + i, i, i % 4 != 0, 20 + i % 30));
  // Interrupted and done again: only the last one of each task counts.
  for (std::uint32_t i = 0; i < 10; ++i) all.push_back(task(401 + i, i, true, 20 + i % 30));
  all.push_back(task(411, 0, false, 30, "blind"));
  store_.record(all);
  const Json list = json({"runs", id_, "evaluations"})["evaluations"];
  ASSERT_EQ(list.size(), 2u);
  const Json& blind = list[0];
  EXPECT_EQ(blind["policy"], "blind");
  EXPECT_EQ(blind["excess"], nullptr);
  EXPECT_EQ(blind["failed"], 1.0);
  const Json& agent = list[1];
  expect_row(blind, "evaluation");
  expect_row(agent, "evaluation");
  EXPECT_EQ(agent["tasks"], 400);
  const double completed = agent["completed"], spl = agent["spl"], low = agent["spl_low"], high = agent["spl_high"];
  EXPECT_NEAR(completed, (300 + 3) / 400.0, 1e-12);
  EXPECT_NEAR(spl, completed, 1e-6) << "every completed one took the shortest path";
  EXPECT_NEAR(agent["excess"].get<double>(), 1, 1e-12);
  // A share of n: the bootstrap's interval is the normal one.
  const double half = 1.96 * std::sqrt(completed * (1 - completed) / 400);
  EXPECT_NEAR(low, spl - half, 0.01);
  EXPECT_NEAR(high, spl + half, 0.01);
  EXPECT_EQ(json({"runs", id_, "evaluations"})["evaluations"], list) << "the same again";
  store_.record(std::vector{task(412, 1, true, 30, "blind")});
  EXPECT_EQ(json({"runs", id_, "evaluations"})["evaluations"][0]["tasks"], 2) << "what is new counts";
}

}  // namespace
}  // namespace citylearn::testing
