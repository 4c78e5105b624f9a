// SPDX-License-Identifier: Apache-2.0
// env_services on streets: their maps are fetched and checked, and they are walked as in process.
#include "core/wire/streets.h"

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <nlohmann/json.hpp>

#include "core/exchange/object.h"
#include "policy_service/env_client/env_client.h"
#include "policy_service/network/belief/street_votes.h"
#include "tests/support/env/env.h"
#include "tests/support/env/env_service_thread.h"
#include "tests/support/env/streets_traversal.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/samples.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

const std::string kLossy = "lossy,drop=0.2,repeat=0.2,reorder=0.2,seed=3:inprocess";

msg::TaskSettings street_task(const Traversal& traversal) {
  msg::TaskSettings with = settings(msg::TRAIN, static_cast<std::uint32_t>(traversal.frames), 1000);
  with.max_detour() = 3;
  return with;
}

/// Chooses an allowed action at random, the same ones for equal observations.
std::vector<std::uint8_t> chosen(const msg::Observation& observation) {
  std::vector<std::uint8_t> choice(observation.frame().size());
  for (std::size_t agent = 0; agent < choice.size(); ++agent)
    choice[agent] = allowed_or_other(static_cast<std::uint8_t>(Random{observation.step(), agent}.below(kActions)),
                                     observation.allowed()[agent]);
  return choice;
}

Bytes bare(msg::Observation observation) {
  observation.header() = msg::Header();
  observation.settings() = msg::SettingsId();
  return encoded(observation);
}

class StreetsTest : public ::testing::Test {
 protected:
  StreetsTest() : run_("streets-" + std::to_string(++runs)) { spdlog::set_level(spdlog::level::warn); }
  ~StreetsTest() override { spdlog::set_level(spdlog::level::info); }

  std::unique_ptr<EnvServiceThread> host(const Traversal& traversal, const std::string& middleware = "inprocess",
                                         int goals = 1) {
    return std::make_unique<EnvServiceThread>(
        EnvServiceOptions{{middleware_options(middleware), "", "", run_}, 3, {}, {}, 0.1, {}, goals}, traversal);
  }
  /// Waits until an env_service has joined, or is refused.
  static EnvHandle* known(EnvClient& client, const std::string& id) {
    const auto found = [&] {
      const auto env = client.envs().find(id);
      return env != client.envs().end() && (env->second->usable() || !env->second->refusal.empty());
    };
    const bool came = eventually([&] { client.spin(Clock::now() + milliseconds(20)); }, found);
    return came ? client.envs().at(id).get() : nullptr;
  }
  static inline int runs = 0;
  const std::string run_;
};

TEST_F(StreetsTest, EnvServicesOfACityShareItsStates) {
  const auto one = host(streets_traversal(small_streets(), StateRule::kStreet, 4, "one")),
             two = host(streets_traversal(small_streets(), StateRule::kStreet, 8, "two")),
             fixed = host(streets_traversal(small_streets(), StateRule::kStreetFixed, 4, "fixed")),
             line = host(small_traversal(20));
  Node node({middleware_options("inprocess"), "policy_service", "policy", run_});
  EnvClient client(node);
  std::vector<EnvHandle*> envs;
  for (const std::string id : {"env-one", "env-two", "env-fixed", "env-line"}) envs.push_back(known(client, id));
  for (const EnvHandle* env : envs) ASSERT_TRUE(env && env->usable());
  ASSERT_TRUE(envs[0]->streets);
  EXPECT_EQ(envs[0]->streets, envs[1]->streets);
  EXPECT_EQ(envs[0]->streets->states(), 13);
  EXPECT_EQ(envs[2]->streets->states(), 7 * 16);
  EXPECT_FALSE(envs[3]->streets);
  EnvRequirements required;
  required.streets = true;
  client.require(required);
  EXPECT_EQ(envs[3]->refusal, "walks on a line, the run on streets");
  required.frames = 12;
  client.require(required);
  EXPECT_EQ(envs[0]->refusal, "walks on streets, whose 13 frames are one route: leave --frames out");
}

TEST_F(StreetsTest, TheyAreWalkedOverTheWireAsInProcess) {
  const Traversal traversal = streets_traversal();
  std::vector<Bytes> expected;
  Environment environment(traversal, 3, {}, 2);
  environment.reset(street_task(traversal));
  for (msg::Observation seen; expected.size() < 100; environment.step(chosen(seen))) {
    environment.observe(seen);
    expected.push_back(bare(seen));
  }
  for (const std::string& middleware : {std::string("inprocess"), kLossy})
    for (const Observing observing : {Observing::kWhole, Observing::kByReference}) {
      const auto running = host(traversal, middleware, 2);
      Node node({middleware_options(middleware), "policy_service", "policy", run_});
      EnvClientOptions options;
      options.observing = observing;
      EnvClient client(node, options);
      std::vector<Bytes> shown;
      client.decide = [&](EnvHandle&, const msg::Observation& seen, std::vector<std::uint8_t>& choice) {
        shown.push_back(bare(seen));
        choice = chosen(seen);
        return true;
      };
      client.joined = [&](EnvHandle& env) {
        EXPECT_TRUE(env.streets) << "it joins with its map";
        client.command(env, street_task(traversal));
      };
      ASSERT_TRUE(eventually([&] { client.spin(Clock::now() + milliseconds(20)); },
                             [&] { return shown.size() >= expected.size(); }));
      shown.resize(expected.size());
      EXPECT_TRUE(shown == expected) << middleware;
    }
}

/// Announces streets, and serves a map that may be another one.
class Mapmaker {
 public:
  Mapmaker(const std::string& run, const StreetMap& announced, const std::optional<StreetMap>& served)
      : node_({middleware_options("inprocess"), "env_service", "mapmaker", run}),
        server_(
            [served](const ObjectKey& key) -> std::shared_ptr<const ObjectBytes> {
              if (!served) return nullptr;
              return std::make_shared<ObjectBytes>(key, encode_streets(*served));
            },
            node_.traffic.rejected) {
    node_.create_reader<msg::StreetsRequest>();
    info.traversal() = "mapmaker";
    info.agents() = 1;
    info.feature_dimension() = 2;
    info.rule() = msg::STREET;
    info.frames() = info.links() = static_cast<std::uint32_t>(announced.links());
    info.places() = static_cast<std::uint32_t>(announced.places());
    info.streets_hash() = announced.hash();
  }
  /// Returns why a run does not use it.
  std::string refusal(EnvClient& client) {
    node_.publish(info);
    const auto turn = [&] {
      client.spin(Clock::now() + milliseconds(5));
      node_.wait(Clock::now() + milliseconds(1));
      for (msg::StreetsRequest request; node_.take(request);)
        server_.answer(request, chunk_, [&] { node_.publish(chunk_); });
    };
    const auto refused = [&] {
      return client.envs().contains("mapmaker") && !client.envs().at("mapmaker")->refusal.empty();
    };
    return eventually(turn, refused) ? client.envs().at("mapmaker")->refusal : "nothing";
  }
  msg::TraversalInfo info = sample_of<msg::TraversalInfo>(Size::kMin);

 private:
  Node node_;
  ObjectServer server_;
  msg::StreetsChunk chunk_;
};

TEST_F(StreetsTest, WrongMapsAreRefusedInOneLine) {
  const StreetMap right = small_streets();
  StreetMap moved = right, turned = right, smaller = right;
  moved.north[3] += 1;
  std::swap(turned.to[0], turned.to[1]), std::swap(turned.heading[0], turned.heading[1]);
  smaller.from.pop_back(), smaller.to.pop_back(), smaller.heading.pop_back();
  int count = 0;
  const auto refusal = [&](const StreetMap& announced, const std::optional<StreetMap>& served, std::uint32_t frames) {
    const std::string run = run_ + "-" + std::to_string(++count);
    Node node({middleware_options("inprocess"), "policy_service", "policy", run});
    EnvClientOptions options;
    options.patience = milliseconds(2000);
    EnvClient client(node, options);
    Mapmaker mapmaker(run, announced, served);
    mapmaker.info.frames() = frames;
    return mapmaker.refusal(client);
  };
  EXPECT_EQ(refusal(right, right, 20), "has 20 frames for 13 states of its streets");
  EXPECT_EQ(refusal(right, moved, 13), "serves another street map than it announced");
  EXPECT_EQ(refusal(right, smaller, 13), "serves a street map of 7 places and 12 links, and announced 7 and 13");
  EXPECT_EQ(refusal(turned, turned, 13), "street map, link 1: is not in order: by place, then clockwise from north");
  EXPECT_EQ(refusal(right, std::nullopt, 13), "has no street map");
}

TEST_F(StreetsTest, ARunEvaluatesItsControlsOnThem) {
  Trial trial("simulated");
  const auto env_service = std::make_unique<EnvServiceThread>(
      EnvServiceOptions{{trial.middleware(), "", "", "default"}, 8, {}, {}, 0.1}, streets_traversal());
  const auto policy = trial.policy({"--mode", "evaluate", "--train", "streets", "--agent", "shortest_path",
                                    "--controls", "all", "--tasks", "64", "--output", trial.folder() / "out"});
  ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
  const auto summary = nlohmann::json::parse(contents(trial.folder() / "out/summary.json"));
  const auto spl = [&](const std::string& name) { return summary["controls"][name]["streets"]["spl"].get<double>(); };
  EXPECT_EQ(summary["evaluate"]["streets"]["spl"], 1);
  EXPECT_GT(spl("sequence_filter"), 0.95);
  EXPECT_GT(spl("oracle_filter"), 0.95);
  EXPECT_LT(spl("blind"), 0.9);
  EXPECT_FALSE(summary["controls"].contains("shuffled"));
  const auto wrong =
      trial.policy({"--mode", "evaluate", "--train", "streets", "--agent", "blind", "--frames", "0:5", "--wait", "2"});
  EXPECT_EQ(wrong->wait(kLongWait), 1) << wrong->output();
  EXPECT_TRUE(contains(wrong->output(), "whose 13 frames are one route: leave --frames out")) << wrong->output();
}

TEST_F(StreetsTest, ACheckpointWalksItsStreetsWithoutThoseOfTrainAndOthersWithThem) {
  Trial trial("simulated");
  const auto hosted = [&](const StreetMap& streets, const std::string& name) {
    return std::make_unique<EnvServiceThread>(
        EnvServiceOptions{{trial.middleware(), "", "", "default"}, 8, {}, {}, 0.1},
        streets_traversal(streets, StateRule::kStreet, 16, name));
  };
  auto summer = hosted(small_streets(), "summer");
  const auto training = trial.policy({"--train", "summer", "--learner", "relabel", "--steps", "4000", "--tasks", "10",
                                      "--output", trial.folder() / "run"});
  ASSERT_EQ(training->wait(kLongWait), 0) << training->output();
  summer.reset();
  const auto evaluation = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words{
        "--mode",      "evaluate", "--checkpoint",        trial.folder() / "run/checkpoints/best.clk", "--tasks", "32",
        "--overwrite", "--output", trial.folder() / "out"};
    words.insert(words.end(), more.begin(), more.end());
    return trial.policy(words);
  };
  const auto spl = [&](const std::string& traversal) {
    return nlohmann::json::parse(contents(trial.folder() / "out/summary.json"))["evaluate"][traversal]["spl"]
        .get<double>();
  };
  const auto fall = hosted(small_streets(), "fall");
  const auto alone = evaluation({"--evaluate", "fall"});
  ASSERT_EQ(alone->wait(kLongWait), 0) << alone->output();
  EXPECT_GT(spl("fall"), 0.9);

  StreetMap moved = small_streets();
  moved.east[4] += 1;
  const auto there = hosted(moved, "there");
  const auto elsewhere = evaluation({"--train", "other", "--evaluate", "there"});
  ASSERT_EQ(elsewhere->wait(seconds(3)), std::nullopt) << "waits for 'other': " << elsewhere->output();
  const auto other = hosted(moved, "other");  // only now
  ASSERT_EQ(elsewhere->wait(kLongWait), 0) << elsewhere->output();
  EXPECT_GT(spl("there"), 0.9);
}

}  // namespace
}  // namespace citylearn::testing
