// SPDX-License-Identifier: Apache-2.0
// The dashboard's REST API: what is alive, wrong requests, and many at once.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <thread>

#include "tests/support/processes/service.h"
#include "tests/unit/dashboard/api/api_fixture.h"

namespace citylearn::testing {
namespace {

TEST_F(ApiTest, WhatIsAlive) {
  EXPECT_EQ(json({"services"})["services"][0]["id"], "env-summer");
  EXPECT_EQ(json({"map", "00000000000000ab"})["frames"], 2);
  const Answer coming = ask({"map", "00000000000000cd"});
  EXPECT_EQ(coming.status, 503);
  ASSERT_EQ(coming.headers.size(), 1u);
  EXPECT_EQ(coming.headers[0].first, "Retry-After");
  expect_error(404, "00000000000000ef", {"map", "00000000000000ef"});
  const Answer picture = ask({"frames", "00000000000000ab", "7"});
  EXPECT_EQ(picture.status, 200);
  EXPECT_EQ(picture.type, "image/jpeg");
  EXPECT_EQ(picture.body, "\xFF\xD8");
  EXPECT_TRUE(contains(picture.headers.at(0).second, "immutable"));
  EXPECT_EQ(ask({"frames", "00000000000000ab", "8"}).status, 503);
  EXPECT_EQ(ask({"frames", "00000000000000ab", "9"}).status, 404);
  for (const std::string hash :
       {"", "ab", "00000000000000AB", "00000000000000ag", "-0000000000000ab", "../../etc/passwd"})
    expect_error(400, "hash", {"frames", hash, "7"});
  for (const std::string index : {"", "-1", "7x", "99999999999"})
    expect_error(400, "index", {"frames", "00000000000000ab", index});
}

TEST_F(ApiRunTest, AnswersFromTheStoreWhatNoEnvServiceHasAnyMore) {
  store_.record(std::vector{episode(1)});
  store_.describe(traversal_info());
  RouteStore routes(store_);
  RouteMap map;
  map.frames = 3;
  map.position = {0, std::nanf(""), 2.5f};
  constexpr std::uint64_t kHash = 0xFEDCBA9876543210;
  const std::string hash = "fedcba9876543210";
  expect_error(404, "no map of it is stored", {"map", hash});
  expect_error(404, "none is stored", {"frames", hash, "7"});
  ASSERT_TRUE(routes.keep(kHash, map));
  ASSERT_TRUE(routes.keep(kHash, {{1, 0, 159}, 7}, {"image/jpeg", "\xFF\xD8"}));
  expect_row(json({"map", hash}), "map");
  EXPECT_EQ(
      json({"map", hash}),
      Json::parse(
          R"({"hash":"fedcba9876543210","frames":3,"index":[0,1,2],"position":[0,null,2.5],"latitude":null,"longitude":null,"streets":null})"));
  const auto index = [&](const QueryParameters& part) { return json({"map", hash}, part)["index"].dump(); };
  EXPECT_EQ(index({{"first", "1"}}), "[1,2]");
  EXPECT_EQ(index({{"last", "1"}}), "[0,1]");
  EXPECT_EQ(index({{"points", "2"}}), "[0,2]");
  EXPECT_EQ(index({{"first", "3"}}), "[]");
  expect_error(400, "'last'", {"map", hash}, {{"first", "2"}, {"last", "1"}});
  expect_error(400, "'points'", {"map", hash}, {{"points", "70000"}});
  const auto header = [](const Answer& answer, const std::string& name) {
    for (const auto& [key, value] : answer.headers)
      if (key == name) return value;
    return std::string();
  };
  const Answer exact = ask({"frames", hash, "7"});
  EXPECT_EQ(exact.status, 200);
  EXPECT_EQ(exact.body, "\xFF\xD8");
  EXPECT_EQ(exact.type, "image/jpeg");
  EXPECT_EQ(header(exact, "X-Frame"), "7");
  EXPECT_EQ(header(exact, "Cache-Control"), "no-store") << "a living env_service may have a larger one";
  expect_error(404, "none is stored", {"frames", hash, "9"});
  const Answer nearest = ask({"frames", hash, "9"}, {{"nearest", "1"}});
  EXPECT_EQ(nearest.status, 200);
  EXPECT_EQ(header(nearest, "X-Frame"), "7");
  expect_error(400, "'nearest'", {"frames", hash, "9"}, {{"nearest", "yes"}});
  EXPECT_EQ(ask({"frames", "00000000000000ab", "7"}, {{"nearest", "1"}}).body, "\xFF\xD8")
      << "what is live comes first";
  EXPECT_EQ(ask({"frames", "00000000000000ab", "8"}, {{"nearest", "1"}}).status, 503);
}

TEST_F(ApiTest, NothingAliveIsNoError) {
  Api alone(options_, store_, nullptr);
  EXPECT_EQ(alone.answer({"GET", {"services"}, {}}).status, 200);
  EXPECT_EQ(alone.answer({"GET", {"events"}, {}}).status, 200);
  EXPECT_EQ(alone.answer({"GET", {"map", "00000000000000ab"}, {}}).status, 404);
}

TEST_F(ApiTest, EventsOfBothNewestFirst) {
  store_.record(Event{1, "demo", "policy", "run", "begins"});
  store_.record(Event{3, "", "dashboard", "alarm", "nothing is recorded"});
  store_.record(Event{2, "demo", "env-summer", "lost", "no heartbeat"});  // as the live one
  const Json events = json({"events"})["events"];
  ASSERT_EQ(events.size(), 3u);
  expect_row(events[0], "event");
  EXPECT_EQ(events[0]["kind"], "alarm");
  EXPECT_EQ(events[2]["kind"], "run");
  EXPECT_EQ(json({"events"}, {{"limit", "1"}})["events"].size(), 1u);
}

TEST_F(ApiTest, About) {
  store_.record(episodes(1, 3));
  const Json about = json({"about"});
  expect_row(about, "about");
  EXPECT_EQ(about["vendor"], "cyclonedds");
  EXPECT_EQ(about["domain"], 42);
  EXPECT_EQ(about["recording"], true);
  EXPECT_EQ(about["store"]["episodes"], 3);
  EXPECT_EQ(about["store"]["file"], store_.path());
  EXPECT_GT(about["store"]["bytes"].get<std::uint64_t>(), 10'000u);
}

TEST_F(ApiRunTest, DeletesARun) {
  expect_error(409, "is running", {"runs", id_}, {}, "DELETE");
  store_.record(ended(run_info(0, 500, 2)));
  const Answer answer = ask({"runs", id_}, {}, "DELETE");
  EXPECT_EQ(answer.status, 204);
  EXPECT_EQ(answer.body, "");
  expect_error(404, id_, {"runs", id_}, {}, "DELETE");
  expect_error(404, id_, {"runs", id_, "training"});
}

TEST_F(ApiRunTest, WrongRequestsAreToldWhatIsWrong) {
  store_.record(training_stats(1, 3));
  const std::vector<std::string> training = {"runs", id_, "training"}, episodes = {"runs", id_, "episodes"};
  expect_error(400, "'points'", training, {{"points", "9"}});
  expect_error(400, "10..20000", training, {{"points", "20001"}});
  expect_error(400, "'points'", training, {{"points", "1e3"}});
  expect_error(400, "'points'", training, {{"points", ""}});
  expect_error(400, "'x'", training, {{"x", "reward"}});
  expect_error(400, "'columns' names 'rewards'", training, {{"columns", "spl,rewards"}});
  expect_error(400, "'columns' names ''", training, {{"columns", "spl,"}});
  expect_error(400, "twice", training, {{"columns", "spl,spl"}});
  expect_error(400, "'from'", training, {{"from", "nan"}});
  expect_error(400, "'to'", training, {{"to", "inf"}});
  expect_error(400, "'column' is not known", training, {{"column", "spl"}});
  expect_error(400, "'limit'", episodes, {{"limit", "0"}});
  expect_error(400, "'before'", episodes, {{"before", "-1"}});
  expect_error(400, "'before' goes with", episodes, {{"before", "1"}, {"order", "worst"}});
  expect_error(400, "'order'", episodes, {{"order", "best"}});
  expect_error(400, "'evaluation'", episodes, {{"evaluation", "true"}});
  expect_error(400, "'update'", episodes, {{"update", "99999999999999999999"}});
  expect_error(400, "'limit'", {"events"}, {{"limit", "x"}});
  expect_error(400, "'y' is not known", {"runs"}, {{"y", "1"}});
  expect_error(404, "nothing of this name", {});
  expect_error(404, "nothing of this name", {"passwd"});
  expect_error(404, "nothing of this name", {"runs", id_, "training", "more"});
  expect_error(404, "a run has no 'secrets'", {"runs", id_, "secrets"});
  expect_error(404, "run 'nobody' not found", {"runs", "nobody"});
  expect_error(405, "POST", {"runs"}, {}, "POST");
  expect_error(405, "DELETE", {"events"}, {}, "DELETE");
  EXPECT_EQ(ask({"runs", id_}, {}, "PUT").headers.at(0).second, "GET, DELETE");
}

TEST_F(ApiTest, ARunOfARecordingGoesOnWhileItsPolicyServiceIsHeard) {
  store_.record(run_info());
  options_.replays = true;
  options_.silence = -1;
  const auto state = [&] { return Api(options_, store_, &live_).runs()["runs"][0]["state"]; };
  EXPECT_EQ(state(), "lost") << "its policy_service was never heard";
  live_.policy = true;
  EXPECT_EQ(state(), "running") << "however long ago that was: the recording may be slow";
  options_.silence = 5;
  live_.policy = false;
  EXPECT_EQ(state(), "lost");
}

TEST_F(ApiRunTest, ManyAskAtOnceWhileItIsWritten) {
  std::atomic<bool> done = false;
  std::vector<std::thread> readers;
  std::atomic<int> wrong = 0, answers = 0;
  for (int i = 0; i < 4; ++i)
    readers.emplace_back([&] {
      while (!done) {
        const std::string all = api_.answer({"GET", {"runs", id_, "episodes"}, {{"limit", "10000"}}}).body;
        wrong += occurrences(all, "\"rowid\"") % 50 != 0;  // what is committed together is seen together
        ++answers;
      }
    });
  for (std::uint64_t first = 1; first <= 1000; first += 50) store_.record(episodes(first, first + 49));
  EXPECT_TRUE(poll_until([&] { return answers >= 8; }, seconds(20)));
  done = true;
  for (std::thread& reader : readers) reader.join();
  EXPECT_EQ(wrong, 0);
}

TEST_F(ApiTest, ADeeplyNestedManifestIsNone) {
  msg::RunInfo info = run_info();
  const std::string manifest = "{\"a\":" + std::string(20'000, '[') + std::string(20'000, ']') + "}";
  info.manifest(std::vector<std::uint8_t>(manifest.begin(), manifest.end()));
  store_.record(info);
  EXPECT_EQ(json({"runs", id_})["manifest"], nullptr);
}

}  // namespace
}  // namespace citylearn::testing
