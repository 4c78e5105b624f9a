// SPDX-License-Identifier: Apache-2.0
// A policy_service's EnvClient and env_services: observations by reference are those with features.
#include "policy_service/env_client/env_client.h"

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <string>

#include "core/util/random.h"
#include "tests/support/env/env.h"
#include "tests/support/env/env_service_thread.h"
#include "tests/support/options.h"
#include "tests/support/records/samples.h"
#include "tests/support/text.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

/// A route of frames with so many features that each lies in several chunks.
Traversal wide_traversal(const std::string& name, int frames, int dimension) {
  Traversal traversal;
  traversal.dataset = "test";
  traversal.name = name;
  traversal.frames = frames;
  traversal.dimension = dimension;
  Random random{static_cast<std::uint64_t>(dimension)};
  for (int i = 0; i < frames * dimension; ++i) traversal.features.push_back(static_cast<float>(random.uniform()));
  traversal.positions.assign(static_cast<std::size_t>(frames), 0.0f);
  return traversal;
}

/// An env_service on `traversal` in a thread of its own.
struct Host : EnvServiceThread {
  Host(const Traversal& traversal, int agents, const std::string& run, const std::string& middleware = "inprocess")
      : EnvServiceThread({{middleware_options(middleware), "", "", run}, agents, {}, {}, 5}, traversal) {}
};

/// An EnvClient that acts by the masks alone and keeps what it is shown.
class Player {
 public:
  explicit Player(const std::string& run, const EnvClientOptions& options = {},
                  const std::string& middleware = "inprocess")
      : node({middleware_options(middleware), "policy_service", "policy", run}), client(node, options) {
    client.decide = [this](EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
      msg::Observation without = observation;
      without.header() = msg::Header();
      without.settings() = msg::SettingsId();
      shown[env.id].push_back(encoded(without));
      choice.resize(observation.frame().size());
      for (std::size_t agent = 0; agent < choice.size(); ++agent) {
        Random random{observation.step(), agent};
        do choice[agent] = static_cast<std::uint8_t>(random.below(kActions));
        while (!(observation.allowed()[agent] >> choice[agent] & 1));
      }
      return true;
    };
  }
  bool until(const std::function<bool()>& condition) {
    return eventually([this] { client.spin(Clock::now() + milliseconds(20)); }, condition);
  }
  EnvHandle* env(const std::string& id) {
    return until([&] { return client.envs().contains(id); }) ? client.envs().at(id).get() : nullptr;
  }

  Node node;
  EnvClient client;
  std::map<std::string, std::vector<Bytes>> shown;  ///< observations answered, by env_service
};

msg::TaskSettings route(std::uint32_t first, std::uint32_t frames) {
  msg::TaskSettings with = settings(msg::TRAIN, frames, 20);
  with.first_frame() = first;
  return with;
}

class EnvClientTest : public ::testing::Test {
 protected:
  EnvClientTest() : run_("client-" + std::to_string(getpid()) + "-" + std::to_string(++clients)) {
    spdlog::set_level(spdlog::level::warn);
  }
  ~EnvClientTest() override { spdlog::set_level(spdlog::level::info); }
  static inline int clients = 0;
  const std::string run_;
};

TEST_F(EnvClientTest, ByReferenceEveryObservationIsTheSame) {
  const Traversal traversal = wide_traversal("wide", 40, 15000);
  constexpr std::size_t kSteps = 30;
  for (const std::string middleware : {"inprocess", "lossy,drop=0.2,repeat=0.2,reorder=0.2,seed=3:inprocess"}) {
    const std::string run = run_ + middleware.substr(0, 5);
    const Host host(traversal, 3, run, middleware);
    for (const bool shuffle : {false, true}) {
      std::vector<Bytes> seen[2];
      for (const bool by_reference : {false, true}) {
        EnvClientOptions options;
        options.observing = by_reference ? Observing::kByReference : Observing::kWhole;
        Player player(run, options, middleware);
        EnvHandle* env = player.env("env-wide");
        ASSERT_TRUE(env);
        msg::TaskSettings with = route(7, 30);
        with.shuffle() = shuffle;
        player.client.command(*env, with);
        EXPECT_EQ(env->settings.by_reference(), by_reference);
        ASSERT_TRUE(player.until([&] { return player.shown["env-wide"].size() >= kSteps; })) << middleware;
        seen[by_reference] = player.shown["env-wide"];
        seen[by_reference].resize(kSteps);
      }
      EXPECT_TRUE(seen[0] == seen[1]) << middleware << (shuffle ? ", shuffled" : "");
    }
  }
}

TEST_F(EnvClientTest, AsksForWhatFitsOneDatagramWholeAndForMoreByReference) {
  const Traversal fits = wide_traversal("fits", 10, 5000), more = wide_traversal("more", 10, 5001);
  const Host one(fits, 3, run_), two(more, 3, run_);  // 60,000 and 60,012 bytes
  Player player(run_);
  for (const std::string id : {"env-fits", "env-more"}) {
    EnvHandle* env = player.env(id);
    ASSERT_TRUE(env);
    player.client.command(*env, route(0, 10));
    EXPECT_EQ(env->settings.by_reference(), id == "env-more");
    EXPECT_TRUE(player.until([&] { return player.shown[id].size() >= 3; }));
  }
  msg::TraversalInfo info = sample_of<msg::TraversalInfo>(Size::kMin);
  info.frames() = 10;
  info.feature_dimension() = 2;
  info.images() = true;
  Node host({middleware_options("inprocess"), "pictures", "pictures", run_});
  host.create_writer<msg::TraversalInfo>();
  host.publish(info);
  EnvHandle* pictures = player.env("pictures");
  ASSERT_TRUE(pictures);
  player.client.command(*pictures, route(0, 10));
  EXPECT_TRUE(pictures->settings.by_reference()) << "an encoder_service has them";
}

TEST_F(EnvClientTest, ARestartedEnvServiceGoesOnWithTheFeaturesFetchedBefore) {
  const Traversal traversal = wide_traversal("wide", 20, 30000);
  Node spy({middleware_options("inprocess"), "spy", "spy", run_});
  spy.create_reader_at<msg::TraversalRequest>("env-wide");
  const auto requests = [&] {
    msg::TraversalRequest request;
    int count = 0;
    while (spy.take(request)) ++count;
    return count;
  };
  auto host = std::make_unique<Host>(traversal, 2, run_);
  Player player(run_);
  int joined = 0;
  std::size_t before = 0;  // observations that came before the last one joined
  player.client.joined = [&](EnvHandle& env) {
    ++joined;
    before = player.shown["env-wide"].size();
    player.client.command(env, route(0, 20));
  };
  ASSERT_TRUE(player.until([&] { return player.shown["env-wide"].size() >= 5; }));
  EXPECT_GT(requests(), 0);
  host.reset();
  host = std::make_unique<Host>(traversal, 2, run_);
  ASSERT_TRUE(player.until([&] { return joined == 2; }));
  ASSERT_TRUE(player.until([&] { return player.shown["env-wide"].size() >= before + 5; }));
  EXPECT_TRUE(player.shown["env-wide"][before] == player.shown["env-wide"][0]);
  EXPECT_EQ(requests(), 0) << "fetched once";
  // Features asked for directly are those at hand, too.
  const auto some = player.client.fetch_features(*player.env("env-wide"), 3, 2, kMaxWait);
  EXPECT_EQ(some, std::vector<float>(traversal.features.begin() + 3 * 30000, traversal.features.begin() + 5 * 30000));
  EXPECT_EQ(requests(), 0);
}

TEST_F(EnvClientTest, FeaturesOfAnUnknownSenderAreRejected) {
  // An env_service that announces a traversal, and a stranger who answers in its place.
  Node owner({middleware_options("inprocess"), "owner", "owner", run_});
  Node stranger({middleware_options("inprocess"), "stranger", "stranger", run_});
  msg::TraversalInfo info = sample_of<msg::TraversalInfo>(Size::kMin);
  info.traversal() = "road";
  info.hash() = 77;
  info.frames() = 3;
  info.feature_dimension() = 2;
  msg::TraversalChunk chunk;
  chunk.receiver() = "policy";
  const std::vector<float> positions(3), features(2, 5.0f);
  traversal_object({77, 2, 0}, positions, [&](std::uint32_t) {
    return std::span<const float>(features);
  })->fill(0, chunk);
  Player player(run_, {.observing = Observing::kByReference});
  owner.publish(info);
  ASSERT_TRUE(player.env("owner"));
  player.client.command(*player.env("owner"), route(0, 3));
  const auto& route = player.env("owner")->features;
  stranger.publish(chunk);
  ASSERT_TRUE(player.until([&] { return player.node.traffic.rejected == 1; }));
  EXPECT_FALSE(route->complete());
  owner.publish(chunk);
  ASSERT_TRUE(player.until([&] { return route->complete(); }));
  EXPECT_EQ(player.node.traffic.rejected, 1u);
  stranger.publish(chunk);
  owner.publish(info);
  ASSERT_TRUE(player.until([&] { return player.node.traffic.received >= 5; }));
  EXPECT_EQ(player.node.traffic.rejected, 1u) << "nobody wants it any more";
}

TEST_F(EnvClientTest, AnErrorAboutOneEnvServiceConcernsItAlone) {
  const Host one(small_traversal(20), 2, run_);
  const Host two(wide_traversal("two", 20, 2), 2, run_);
  Player player(run_);
  const auto act = player.client.decide;
  player.client.decide = [&](EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
    if (env.id == "env-two" && observation.step() == 5) throw Error("makes no sense");
    return act(env, observation, choice);
  };
  player.client.joined = [&](EnvHandle& env) { player.client.command(env, route(0, 20)); };
  ASSERT_TRUE(player.until([&] { return player.shown["env-line"].size() > 20 && player.env("env-two"); }));
  const EnvHandle& refused = *player.env("env-two");
  ASSERT_TRUE(player.until([&] { return !refused.refusal.empty(); }));
  EXPECT_EQ(refused.refusal, "makes no sense");
  const std::size_t before = player.shown["env-line"].size();
  ASSERT_TRUE(player.until([&] { return player.shown["env-line"].size() > before + 20; }));
}

/// Announces an env_service that confirms no settings.
class Deaf {
 public:
  explicit Deaf(const std::string& run) : node_({middleware_options("inprocess"), "env_service", "deaf", run}) {
    info.frames() = 20;
    info.feature_dimension() = 2;
  }
  void announce() { node_.publish(info); }
  /// Shows an observation of one agent under `settings`.
  void show(const msg::SettingsId& settings, std::uint64_t step) {
    msg::Observation observation = sample_of<msg::Observation>(Size::kMin);
    observation.settings() = settings;
    observation.step() = step;
    observation.feature_dimension() = info.feature_dimension();
    observation.features().assign(info.feature_dimension(), 0.0f);
    observation.frame() = observation.position() = observation.goal() = {0};
    observation.previous_action() = {255};
    observation.reward() = {0};
    observation.flags() = {0};
    observation.allowed() = {1};
    node_.publish(observation);
  }

  msg::TraversalInfo info = sample_of<msg::TraversalInfo>(Size::kMin);

 private:
  Node node_;
};

EnvClientOptions impatient() {
  EnvClientOptions options;
  options.patience = milliseconds(300);
  return options;
}

/// Gives the one that has announced itself settings; null when it is not known.
EnvHandle* commanded(Player& player, Deaf& deaf) {
  deaf.announce();
  EnvHandle* env = player.env("deaf");
  if (env) player.client.command(*env, route(0, 20));
  return env;
}

TEST_F(EnvClientTest, OneThatNeverConfirmsItsSettingsIsRefused) {
  Deaf deaf(run_);
  Player player(run_, impatient());
  EnvHandle* env = commanded(player, deaf);
  ASSERT_TRUE(env);
  EXPECT_TRUE(player.until([&] {
    deaf.announce();
    return !env->refusal.empty();
  }));
  EXPECT_EQ(env->refusal, "does not confirm its settings");
}

TEST_F(EnvClientTest, OneThatRefusesItsSettingsSaysWhy) {
  Traversal traversal = small_traversal(20);
  traversal.goal = 15;
  const Host host(traversal, 2, run_);
  EnvClientOptions options;
  options.patience = seconds(3);
  Player player(run_, options);
  player.client.joined = [&](EnvHandle& env) { player.client.command(env, route(0, 10)); };
  ASSERT_TRUE(player.until([&] { return player.env("env-line") && !player.env("env-line")->refusal.empty(); }));
  EXPECT_EQ(player.env("env-line")->refusal,
            "does not confirm its settings: refused settings: TaskSettings.frames: the route 0..9 is without the goal, "
            "place 15 (ask for another part of the traversal)");
}

TEST_F(EnvClientTest, AnAnnouncementThatObservationsOvertookIsNotARestart) {
  Deaf env_service(run_);
  env_service.info.agents() = 1;
  Player player(run_);
  int joined = 0;
  player.client.joined = [&](EnvHandle& env) {
    ++joined;
    player.client.command(env, route(0, 20));
  };
  env_service.announce();
  EnvHandle* env = player.env("deaf");
  ASSERT_TRUE(env);
  const msg::SettingsId given = env->settings.settings();
  env_service.show(given, 0);
  ASSERT_TRUE(player.until([&] { return env->next_step == 1; }));
  env_service.announce();  // as sent before the settings came
  ASSERT_TRUE(player.until([&] { return env->obeys == 0; }));
  EXPECT_EQ(joined, 1);
  env_service.show(given, 1);
  EXPECT_TRUE(player.until([&] { return env->next_step == 2; })) << "under the same settings";
  // What comes after the announcement of these settings shows that they are lost.
  env_service.info.settings() = given;
  env_service.announce();
  ASSERT_TRUE(player.until([&] { return env->info.settings() == given; }));
  env_service.info.settings() = {};
  env_service.announce();
  ASSERT_TRUE(player.until([&] { return joined == 2; }));
  EXPECT_NE(env->settings.settings(), given);
}

TEST_F(EnvClientTest, OneWhoseEncoderServiceIsSilentIsWaitedFor) {
  Deaf deaf(run_);
  deaf.info.encoder_service() = "killed";
  deaf.info.encoder_incarnation() = 77;
  Player player(run_, impatient());
  EnvHandle* env = commanded(player, deaf);
  ASSERT_TRUE(env);
  const Clock::time_point end = Clock::now() + 4 * impatient().patience;
  EXPECT_TRUE(player.until([&] {
    deaf.announce();
    return Clock::now() > end || !env->refusal.empty();
  }));
  EXPECT_EQ(env->refusal, "") << "nobody passes on that it confirms its settings";
}

TEST_F(EnvClientTest, WhatIsRequiredMayBeMetLater) {
  const Host host(small_traversal(20), 2, run_);
  Player player(run_);
  int joined = 0;
  player.client.joined = [&](EnvHandle&) { ++joined; };
  EnvRequirements required;
  required.frames = 30;
  player.client.require(required);
  EnvHandle* env = player.env("env-line");
  ASSERT_TRUE(env);
  EXPECT_EQ(env->refusal, "has 20 frames, the route needs frames 0..29");
  EXPECT_EQ(joined, 0);
  required.traversals = {"another"};
  player.client.require(required);
  ASSERT_TRUE(player.until([&] { return joined == 1; })) << "it is not for this traversal";
  required.traversals = {"line"};
  player.client.require(required);
  EXPECT_FALSE(env->usable());
  required.frames = 20;
  player.client.require(required);
  ASSERT_TRUE(player.until([&] { return joined == 2; }));
  EXPECT_TRUE(env->usable());
}

TEST_F(EnvClientTest, OfTwoContentsTheSecondIsRefusedUntilTheFirstIsGone) {
  auto first = std::make_unique<Host>(wide_traversal("road", 20, 2), 2, run_);
  Player player(run_);
  ASSERT_TRUE(player.env("env-road"));
  const Traversal other = wide_traversal("road", 20, 3);
  EnvServiceOptions options;
  options.node = {middleware_options("inprocess"), "", "second", run_};
  options.agents = 2;
  const EnvServiceThread second(options, other);
  EnvHandle* refused = player.env("second");
  ASSERT_TRUE(refused);
  EXPECT_TRUE(contains(refused->refusal, "has other contents (20 frames, hash ")) << refused->refusal;
  EXPECT_TRUE(contains(refused->refusal, "than env_service 'env-road'")) << refused->refusal;
  first.reset();
  EXPECT_TRUE(player.until([&] { return refused->usable(); }));
}

TEST_F(EnvClientTest, TheCacheKeepsWhatIsHeldAndLittleElse) {
  Player player(run_);
  FeatureCache cache(player.node, 2000 * sizeof(float));
  msg::TraversalInfo info = sample_of<msg::TraversalInfo>(Size::kMin);
  info.frames() = 100;
  info.feature_dimension() = 100;
  const std::vector<float> features(100, 1.0f), positions(100);
  const auto fetch = [&](std::uint64_t hash, std::uint32_t first, std::uint32_t count) {
    info.hash() = hash;
    auto route = cache.want(info, first, count);
    const bool here = route->complete();
    msg::TraversalChunk chunk;
    traversal_object({hash, 100, 0}, positions, [&](std::uint32_t) {
      return std::span<const float>(features);
    })->fill(0, chunk);
    cache.take(chunk);
    EXPECT_TRUE(route->complete());
    return std::pair(route, here);
  };
  const auto was_here = [&](std::uint64_t hash, std::uint32_t first, std::uint32_t count) {
    return fetch(hash, first, count).second;
  };
  const auto held = fetch(1, 0, 100).first;  // larger than what is kept
  EXPECT_FALSE(was_here(2, 0, 15));
  EXPECT_FALSE(was_here(3, 0, 15));
  EXPECT_TRUE(was_here(2, 0, 15));
  EXPECT_TRUE(was_here(2, 3, 12)) << "within another";
  EXPECT_FALSE(was_here(4, 0, 15)) << "2 is kept, 3 was used before it";
  EXPECT_TRUE(was_here(4, 0, 15));
  EXPECT_TRUE(was_here(2, 0, 15));
  EXPECT_FALSE(was_here(3, 0, 15));
  EXPECT_TRUE(was_here(1, 50, 50)) << "held";
  info.encoder() = "another";
  EXPECT_FALSE(was_here(1, 50, 50)) << "other numbers";
}

}  // namespace
}  // namespace citylearn::testing
