// SPDX-License-Identifier: Apache-2.0
// The dashboard as a program, with the services that it shows.
#include <map>

#include "core/util/random.h"
#include "tests/paths.h"
#include "tests/support/processes/domain.h"
#include "tests/support/text.h"
#include "tests/support/web/server_fixture.h"

namespace citylearn::testing {
namespace {

TEST(Dashboard, PrintsItsAddressServesAndEndsAtASignal) {
  const Folder folder;
  const std::string domain = std::to_string(own_domain());
  const auto command = [&](const std::string& port, const std::string& store) {
    return std::vector<std::string>{CITYLEARN_DASHBOARD, "--port",      port,      "--domain",    domain,
                                    "--session",         "server-test", "--store", folder / store};
  };
  Service dashboard(command("0", "new/first.sqlite"), folder / "log");
  ASSERT_TRUE(dashboard.says("dashboard: http://127.0.0.1:", 20s)) << dashboard.output();
  const std::string output = dashboard.output(), start = "http://127.0.0.1:";
  const auto port = static_cast<std::uint16_t>(std::stoi(output.substr(output.find(start) + start.size())));
  WebClient client(port);
  EXPECT_EQ(Json::parse(client.get("/api/about").body)["session"], "server-test");
  EXPECT_EQ(Json::parse(client.get("/api/runs").body)["runs"], Json::array());
  EXPECT_TRUE(contains(client.get("/metrics").body, "\ncitylearn_dashboard_recording 1\n"));
  Service second(command(std::to_string(port), "second.sqlite"), folder / "second");
  EXPECT_EQ(second.wait(20s), 1);
  EXPECT_TRUE(contains(second.output(), "the port is in use"));
  EXPECT_EQ(dashboard.end(SIGINT, 5s), 0) << dashboard.output();
}

TEST(Dashboard, ShowsATrainingWhileItRunsAndKeepsEachOfItsEpisodes) {
  const Folder folder;
  std::filesystem::create_directories(folder / "data");
  {
    Random random(1);
    std::ofstream features(folder / "data/summer.csv");
    for (int frame = 0; frame < 64; ++frame)
      for (int k = 0; k < 8; ++k) features << random.normal() << (k == 7 ? '\n' : ',');
  }
  const std::string domain = std::to_string(own_domain());
  const auto service = [&](std::vector<std::string> command, const std::string& log) {
    command.insert(command.end(), {"--domain", domain, "--session", "watched"});
    return std::make_unique<Service>(command, folder / log);
  };
  const auto dashboard = service({CITYLEARN_DASHBOARD, "--port", "0", "--store", folder / "store"}, "dashboard.log");
  const std::string start = "http://127.0.0.1:";
  ASSERT_TRUE(dashboard->says(start, 20s)) << dashboard->output();
  const std::string output = dashboard->output();
  const auto port = static_cast<std::uint16_t>(std::stoi(output.substr(output.find(start) + start.size())));
  WebClient live(port);
  const auto asked = [&](const std::string& path) { return Json::parse(WebClient(port).get(path).body); };
  ASSERT_EQ(live.upgrade().status, 101);
  live.say(R"({"watch": ["services", "runs", "events", "scene:env-summer@watched"]})");

  const auto env = service({CITYLEARN_ENV_SERVICE, "--dataset", "plain", "--data", folder / "data", "--traversal",
                            "summer", "--agents", "4"},
                           "env.log");
  const auto policy = service({CITYLEARN_POLICY_SERVICE, "--agent", "place_filter", "--frames", "0:64", "--steps",
                               "150000", "--tasks", "30", "--evaluate", "summer", "--output", folder / "out"},
                              "policy.log");
  // The run's ID comes with the list of runs; then its training is watched too.
  std::map<std::string, int> frames;
  std::string id;
  bool trained = false, moved = false;
  const auto patience = Clock::now() + 60s;
  while ((!trained || !moved || frames["events"] == 0) && Clock::now() < patience) {
    const auto frame = live.take(1s);
    const auto news = news_of(frame);
    if (!news) continue;
    const std::string topic = news->header["topic"];
    ++frames[topic];
    const std::string payload = frame->payload.substr(frame->payload.size() - news->payload);
    if (topic == "runs" && id.empty()) {
      const Json runs = Json::parse(payload);
      for (const Json& run : runs["runs"])
        if (!run["policy"].is_null()) id = run["id"];
      if (!id.empty())
        live.say(Json{{"watch", {"services", "events", "scene:env-summer@watched", "training:" + id}}}.dump());
    }
    moved |= topic.substr(0, 5) == "scene" && news->header["agents"] == 4 && news->header["likely"] == 8 &&
             news->payload == 4u * (6 + 8 + 8 + 2) * 4;  // with beliefs
    if (topic == "training:" + id) {
      trained = true;
      EXPECT_EQ(news->payload, news->header["rows"].get<std::size_t>() * news->header["columns"].size() * 8);
    }
  }
  EXPECT_TRUE(trained && moved) << policy->output();
  EXPECT_GT(frames["services"], 0);
  EXPECT_GT(frames["events"], 0);
  EXPECT_EQ(policy->wait(60s), 0) << policy->output();
  const std::string table = contents(folder / "out/episodes.csv");
  const auto episodes = std::count(table.begin(), table.end(), '\n') - 1;
  EXPECT_GT(episodes, 30);
  EXPECT_TRUE(
      poll_until([&] { return asked("/api/about")["store"]["episodes"].get<std::int64_t>() >= episodes; }, 20s));
  EXPECT_EQ(asked("/api/about")["store"]["episodes"], episodes);

  const auto state = [&](const std::string& name) {
    const Json all = asked("/api/services");
    for (const Json& one : all["services"])
      if (one["id"] == name) return one["state"].get<std::string>();
    return std::string();
  };
  EXPECT_EQ(state("env-summer"), "waiting");
  env->send(SIGKILL);
  const auto killed = Clock::now();
  EXPECT_TRUE(poll_until([&] { return state("env-summer") == "lost"; }, 20s));
  EXPECT_LT(Clock::now() - killed, 4s * kSlowness);
  EXPECT_EQ(dashboard->end(SIGTERM, 5s), 0) << dashboard->output();
}

}  // namespace
}  // namespace citylearn::testing
