// SPDX-License-Identifier: Apache-2.0
// env_services that do not fit a run, or do not do their part: the run names each of them and goes on without it.
#include <gtest/gtest.h>

#include "tests/support/processes/trial.h"
#include "tests/support/records/witness.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class Misfits : public ::testing::Test {
 protected:
  Misfits() : witness_("simulated", trial_.domain()) {}

  /// An env_service with this id on a small city of `frames` frames, which differs by `more`.
  std::unique_ptr<Service> env(const std::string& id, const std::string& traversal, int frames,
                               const Arguments& more = {}) {
    return trial_.env(traversal, Arguments{"--id", id, "--synthetic-frames", std::to_string(frames)} + more);
  }
  std::unique_ptr<Service> policy(const Arguments& more) {
    return trial_.policy(Arguments{"--agent", "place_filter", "--frames", "0:64", "--tasks", "16", "--wait", "20"} +
                         more);
  }
  bool trains(const std::string& id = "policy") {
    return witness_.until([&] { return witness_.updates >= 3 && witness_.status.contains(id); }, kLongWait);
  }
  /// The service's status names the env_service and what is wrong with it.
  void expect_alarm(const std::string& id, const std::string& env, const std::string& what) {
    const auto named = [&] {
      return contains(witness_.alarm(id), "'" + env + "'") && contains(witness_.alarm(id), what);
    };
    EXPECT_TRUE(witness_.until(named, kShortWait)) << env << ": " << witness_.alarm(id);
  }
  void expect_training_goes_on() {
    const std::uint64_t updates = witness_.updates;
    EXPECT_TRUE(witness_.until([&] { return witness_.updates > updates + 3; }, kShortWait));
  }
  static int times_logged(const Service& service, const std::string& env) {
    return occurrences(service.output(), "env_service '" + env + "': is not used");
  }

  Trial trial_{"simulated"};
  Witness witness_;
};

TEST_F(Misfits, EachThatJoinsATrainingIsNamedOnceAndLeftAside) {
  const auto summer = env("summer", "summer", 160);
  const auto run = policy({"--steps", "100000000", "--time-limit", "15"});
  ASSERT_TRUE(trains()) << run->output();
  const std::map<std::string, std::pair<std::string, Arguments>> misfits = {
      {"wide", {"has other contents", {"--synthetic-dimension", "128"}}},
      {"short", {"has other contents", {"--synthetic-frames", "50"}}},
      {"another", {"has other contents", {"--synthetic-seed", "2"}}},
  };
  for (const auto& [id, misfit] : misfits) {
    const auto service = env(id, "summer", 160, misfit.second);
    expect_alarm("policy", id, misfit.first);
    expect_training_goes_on();
  }
  const auto sibling = env("short-winter", "winter", 50);
  expect_alarm("policy", "short-winter", "has 50 frames, the route needs frames 0..63");
  const auto wide_sibling = env("wide-fall", "fall", 160, {"--synthetic-dimension", "128"});
  expect_alarm("policy", "wide-fall", "has 128 features a frame, the training has 64");
  expect_training_goes_on();
  ASSERT_EQ(run->wait(kLongWait), 0) << run->output();
  for (const std::string id : {"wide", "short", "another", "short-winter", "wide-fall"})
    EXPECT_EQ(times_logged(*run, id), 1) << id << "\n" << run->output();
  EXPECT_TRUE(contains(run->output(), "place_filter  summer")) << "evaluated, and nothing else is waited for";
}

TEST_F(Misfits, ATraversalThatOnlyAMisfitHostsIsMissedAfterTheWait) {
  const auto winter = env("short-winter", "winter", 50);
  const auto run = policy({"--mode", "evaluate", "--agent", "blind", "--evaluate", "winter", "--wait", "5"});
  EXPECT_EQ(run->wait(seconds(20)), 1) << run->output();
  EXPECT_TRUE(contains(run->output(),
                       "no env_service on winter within 5 s (found: short-winter on winter, which has "
                       "50 frames, the route needs frames 0..63"))
      << run->output();
}

TEST_F(Misfits, ANameThatNoneHasIsToldBesideThoseThereAre) {
  const auto other = env("other", "winter", 160);
  const auto run = policy({"--mode", "evaluate", "--agent", "blind", "--evaluate", "monday", "--wait", "8"});
  EXPECT_EQ(run->wait(seconds(30)), 1) << run->output();
  for (const std::string begin :
       {"starting: waiting for env_services on monday", "no env_service on monday within 8 s"})
    EXPECT_TRUE(contains(run->output(), begin + " (found: other on winter; none is called monday")) << run->output();
}

TEST_F(Misfits, ADamagedCheckpointLeavesAnEarlierRunAsItIs) {
  for (const std::string name : {"cut.clk", "run/summary.json"}) make_file(trial_.folder() / name, "CLKP");
  for (const Arguments& by : {Arguments{"--mode", "evaluate", "--checkpoint"}, Arguments{"--initial"}}) {
    const auto run =
        policy(by + Arguments{trial_.folder() / "cut.clk", "--output", trial_.folder() / "run", "--overwrite"});
    EXPECT_EQ(run->wait(seconds(20)), 1) << run->output();
    EXPECT_TRUE(contains(run->output(), "cut.clk: ")) << run->output();
    EXPECT_EQ(contents(trial_.folder() / "run/summary.json"), "CLKP");
    EXPECT_FALSE(std::filesystem::exists(trial_.folder() / "run/episodes.csv"));
  }
}

/// Announces a traversal and delivers no features of it. Its id comes first, so that a run asks it for them.
class Miser {
 public:
  explicit Miser(const MiddlewareOptions& middleware) : node_({middleware, "env_service", "a-miser", "default"}) {
    node_.create_writer<msg::TraversalInfo>();
    info_.traversal() = "summer";
    info_.hash() = 7;
    info_.frames() = 160;
    info_.feature_dimension() = 64;
    info_.agents() = 8;
  }
  void introduce() {
    if (Clock::now() < again_) return;
    node_.publish(info_);
    again_ = Clock::now() + milliseconds(500);
  }
  bool joins(const Service& run) {
    return poll_until([&] { return introduce(), contains(run.output(), "'a-miser' joins"); }, kLongWait);
  }

 private:
  Node node_;
  msg::TraversalInfo info_;
  Clock::time_point again_{};
};

TEST_F(Misfits, OneThatDeliversNoFeaturesDoesNotEndATraining) {
  Miser miser(trial_.middleware());
  const auto run = policy({"--steps", "20000"});
  ASSERT_TRUE(miser.joins(*run)) << run->output();
  const auto summer = env("summer", "summer", 160);
  std::optional<int> status;
  EXPECT_TRUE(
      witness_.until([&] { return miser.introduce(), (status = run->wait(milliseconds(1))).has_value(); }, kLongWait))
      << run->output();
  EXPECT_EQ(status, 0) << run->output();
  EXPECT_EQ(times_logged(*run, "a-miser"), 1) << run->output();
  EXPECT_TRUE(contains(run->output(), "parts of its features did not come")) << run->output();
}

TEST_F(Misfits, OneThatDiesBeforeItsFeaturesCameIsNotWaitedFor) {
  const auto run = policy({"--steps", "2000"});
  ASSERT_TRUE(Miser(trial_.middleware()).joins(*run)) << run->output();
  const auto summer = env("summer", "summer", 160);
  EXPECT_EQ(run->wait(seconds(20)), 0) << run->output();
}

TEST_F(Misfits, AStopEndsTheWaitForFeatures) {
  Miser miser(trial_.middleware());
  const auto run = policy({"--steps", "2000"});
  ASSERT_TRUE(miser.joins(*run)) << run->output();
  EXPECT_TRUE(witness_.until(
      [&] { return miser.introduce(), contains(witness_.status["policy"].activity().c_str(), "features of 'summer'"); },
      kShortWait));
  EXPECT_EQ(run->end(SIGTERM, seconds(3)), 130) << run->output();
  EXPECT_EQ(occurrences(run->output(), "'a-miser' joins"), 1) << run->output();
}

TEST_F(Misfits, AnEvaluationGoesOnWithAnotherWhenItsOwnDies) {
  auto one = env("one", "summer", 160);
  const auto run = policy({"--mode", "evaluate", "--agent", "blind", "--tasks", "1000000"});
  ASSERT_TRUE(witness_.until([&] { return witness_.episodes("one") > 0; }, kLongWait)) << run->output();
  const auto two = env("two", "summer", 160);
  ASSERT_TRUE(run->says("'two' joins", kLongWait)) << run->output();
  one.reset();
  EXPECT_TRUE(witness_.until([&] { return witness_.episodes("two") > 0; }, kShortWait)) << run->output();
  two->send(SIGKILL);
  const auto named = [&] {
    const msg::ServiceStatus& status = witness_.status["policy"];
    return status.service_state() == msg::WAITING && contains(status.activity().c_str(), "'two'");
  };
  EXPECT_TRUE(witness_.until(named, kShortWait)) << run->output();
}

TEST_F(Misfits, LearnerAndActorsRefuseOtherContentsToo) {
  const auto summer = env("summer", "summer", 160);
  const auto learner = policy({"--role", "learner", "--steps", "100000000", "--trainer-agents", "8"});
  const auto actor = trial_.policy({"--role", "actor", "--id", "actor"});
  ASSERT_TRUE(trains()) << learner->output() << actor->output();
  const auto another = env("another", "summer", 160, {"--synthetic-seed", "2"});
  expect_alarm("policy", "another", "has other contents");
  expect_training_goes_on();
  EXPECT_FALSE(contains(actor->output(), "serving env_service 'another'")) << actor->output();
}

/// A learner of other features than the env_services have, as with two encoder_services.
TEST_F(Misfits, AnActorServesNoEnvServiceThatItsLearnerDoesNotKnow) {
  const auto summer = env("summer", "summer", 160);
  const auto learner = policy({"--role", "learner", "--steps", "100000000", "--trainer-agents", "8"});
  Node stranger({trial_.middleware(), "policy_service", "stranger", "default"});
  msg::LearnerInfo info;
  stranger.create_reader<msg::LearnerInfo>();
  ASSERT_TRUE(witness_.until([&] { return stranger.take(info); }, kLongWait)) << learner->output();
  ASSERT_EQ(learner->end(SIGKILL, seconds(5)), 128 + SIGKILL);
  info.feature_dimension() = 4096;
  const auto actor = trial_.policy({"--role", "actor", "--id", "actor"});
  msg::Assignment order;
  order.actor() = "actor";
  order.environment() = "summer";
  order.environment_incarnation() = witness_.incarnation("summer");
  order.serve() = true;
  Clock::time_point again{};
  const auto announced = [&] {
    if (Clock::now() >= again) {
      stranger.publish(info);
      order.actor_incarnation() = witness_.status["actor"].header().incarnation();
      stranger.publish(order);
      again = Clock::now() + milliseconds(500);
    }
    return contains(witness_.alarm("actor"), "has 64 features a frame, the training has 4096");
  };
  EXPECT_TRUE(witness_.until(announced, kLongWait)) << witness_.alarm("actor") << "\n" << actor->output();
  EXPECT_EQ(actor->end(SIGTERM, seconds(5)), 130) << actor->output();
}

}  // namespace
}  // namespace citylearn::testing
