// SPDX-License-Identifier: Apache-2.0
// The dashboard's recorder, against scripted services in the same process.
#include "dashboard/store/recorder.h"

#include <gtest/gtest.h>

#include <deque>

#include "dashboard/store/database.h"
#include "dashboard/store/store_reader.h"
#include "tests/support/options.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/records.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

constexpr std::uint32_t kDomain = 210;

Node::Options recorder_node_options(const std::string& middleware, const std::string& service, const std::string& id) {
  return {middleware_options(middleware, kDomain), service, id, "demo"};
}

/// Keeps its episodes until they are acknowledged, and sends them again; nothing else.
class ScriptedEnvironment {
 public:
  explicit ScriptedEnvironment(const std::string& middleware = "inprocess")
      : node(recorder_node_options(middleware, "env_service", "env-summer")) {
    node.create_writer<msg::EpisodeStat>();
    node.create_reader<msg::EpisodeAcknowledgement>();
  }
  void finish_episodes(std::uint64_t count) {
    for (std::uint64_t i = 0; i < count; ++i) {
      msg::EpisodeStat stat = episode(++episodes);
      stat.acknowledged(acknowledged);
      kept.push_back(stat);
      node.publish(kept.back());
    }
  }
  void spin() {
    node.wait(Clock::now());
    msg::EpisodeAcknowledgement message;
    while (node.take(message)) {
      if (message.environment() != node.options().id || message.environment_incarnation() != node.incarnation())
        continue;
      ++acknowledgements;
      registered = true;
      left = message.recorder() == msg::LEAVES;
      newest = message.episode();
      while (!kept.empty() && kept.front().episode() <= message.episode()) kept.pop_front();
      acknowledged = std::max(acknowledged, message.episode());
    }
    if (Clock::now() < again) return;
    again = Clock::now() + milliseconds(50);
    for (std::size_t i = 0; i < std::min<std::size_t>(64, kept.size()); ++i) node.publish(kept[i]);
  }
  Node node;
  std::deque<msg::EpisodeStat> kept;
  std::uint64_t episodes = 0, acknowledged = 0, newest = 0;
  int acknowledgements = 0;
  bool registered = false, left = false;
  Clock::time_point again;
};

/// Has made some updates, of which it sends those it is asked for, `most` at a time.
class ScriptedLearner {
 public:
  ScriptedLearner() {
    node.create_writer<msg::TrainingStat>();
    node.create_writer<msg::RunInfo>();
    node.create_reader<msg::TrainingStatRequest>();
  }
  void say(std::uint64_t updates) {
    msg::RunInfo info = run_info(updates);
    node.publish(info);
  }
  void send(std::uint64_t update) {
    msg::TrainingStat stat = training_stat(update);
    node.publish(stat);
  }
  void spin() {
    node.wait(Clock::now());
    msg::TrainingStatRequest request;
    while (node.take(request)) {
      if (request.policy() != node.options().id || request.policy_incarnation() != node.incarnation() ||
          request.run_id() != kJob)
        continue;
      ++requests;
      std::uint64_t most = msg::MAX_STATS_ASKED;
      for (std::uint64_t u = std::max(first, request.first()); u <= std::min(last, request.last()) && most > 0;
           ++u, --most)
        send(u);
    }
  }
  Node node{recorder_node_options("inprocess", "policy_service", "policy")};
  std::uint64_t first = 1, last = 0;  ///< updates that it keeps
  int requests = 0;
};

/// A dashboard without a page: hands on what it takes.
class Dashboard {
 public:
  Dashboard(const Node::Options& options, const Store::Options& store_options, Recorder::Options recorder_options = {})
      : node(options), store(store_options), recorder(node, store, recorder_options) {
    node.create_reader<msg::ServiceStatus>();
    node.create_reader<msg::TraversalInfo>();
    node.create_reader<msg::RunInfo>();
    node.create_reader<msg::TrainingStat>();
    recorder.on_event = [this](const Event& event) { events.push_back(event); };
  }
  void spin() {
    node.wait(std::min(recorder.due(), Clock::now() + milliseconds(5)));
    take<msg::ServiceStatus>();
    take<msg::TraversalInfo>();
    take<msg::RunInfo>();
    take<msg::TrainingStat>();
    recorder.poll();
  }
  bool told(const std::string& text) const {
    for (const Event& event : events)
      if (event.text.find(text) != std::string::npos) return true;
    return false;
  }
  Node node;
  Store store;
  Recorder recorder;
  std::vector<Event> events;

 private:
  template <class Message>
  void take() {
    Message message;
    while (node.take(message)) recorder.on_message(message);
  }
};

class RecorderTest : public ::testing::Test {
 protected:
  Folder folder_;
  Store::Options store_options_;
  Recorder::Options hasty_;

  RecorderTest() {
    store_options_.path = folder_ / "dashboard.sqlite";
    hasty_.request_after = milliseconds(20);
    hasty_.retry_after = milliseconds(50);
  }
  std::unique_ptr<Dashboard> make_dashboard(const std::string& middleware = "inprocess") {
    return std::make_unique<Dashboard>(recorder_node_options(middleware, "dashboard", "dashboard"), store_options_,
                                       hasty_);
  }
  std::int64_t number(const std::string& sql) { return open_database(store_options_.path).execAndGet(sql).getInt64(); }
  template <class... Parties>
  bool until(const std::function<bool()>& condition, Parties&... parties) {
    return eventually([&] { (parties.spin(), ...); }, condition);
  }
};

TEST_F(RecorderTest, MakesItselfKnownToWhoeverItHearsOf) {
  ScriptedEnvironment env;
  const auto dashboard = make_dashboard();
  ASSERT_TRUE(until([&] { return env.registered; }, env, *dashboard));
  EXPECT_EQ(env.newest, 0u);
  EXPECT_FALSE(env.left);
}

TEST_F(RecorderTest, AcknowledgesAfterTheCommit) {
  ScriptedEnvironment env;
  const auto dashboard = make_dashboard();
  env.finish_episodes(1000);
  ASSERT_TRUE(until([&] { return env.kept.empty(); }, env, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(*) FROM episodes"), 1000);
  EXPECT_EQ(dashboard->recorder.recorded(), 1000u);
}

TEST_F(RecorderTest, AFewWaitForOthersButNotForLong) {
  ScriptedEnvironment env;
  const auto dashboard = make_dashboard();
  ASSERT_TRUE(until([&] { return env.registered; }, env, *dashboard));
  env.finish_episodes(3);
  ASSERT_TRUE(until([&] { return env.kept.empty(); }, env, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(DISTINCT recorded) FROM episodes"), 1) << "one transaction";
}

TEST_F(RecorderTest, NothingIsLostOrDoubledOverAWireThatLosesAndRepeats) {
  ScriptedEnvironment env("lossy,drop=0.2,repeat=0.2,reorder=0.2,seed=5:inprocess");
  auto dashboard = make_dashboard("lossy,drop=0.2,repeat=0.2,reorder=0.2,seed=6:inprocess");
  for (int part = 0; part < 4; ++part) {
    env.finish_episodes(150);
    ASSERT_TRUE(until([&] { return env.acknowledged > 150u * static_cast<unsigned>(part) + 20; }, env, *dashboard));
    dashboard.reset();  // gone, in the middle of it
    env.spin();
    dashboard = make_dashboard("lossy,drop=0.2,repeat=0.2,reorder=0.2,seed=7:inprocess");
  }
  ASSERT_TRUE(until([&] { return env.kept.empty(); }, env, *dashboard));
  EXPECT_EQ(env.acknowledged, 600u);
  EXPECT_EQ(number("SELECT COUNT(*) FROM episodes"), 600);
  EXPECT_EQ(number("SELECT MAX(episode) FROM episodes"), 600);
}

TEST_F(RecorderTest, LeavesOnlyWhenToldTo) {
  ScriptedEnvironment env;
  {
    const auto dashboard = make_dashboard();
    ASSERT_TRUE(until([&] { return env.registered; }, env, *dashboard));
    env.finish_episodes(5);
    dashboard->recorder.finish(false);
    env.spin();
    EXPECT_FALSE(env.left);
    EXPECT_TRUE(env.kept.empty()) << "what has come is recorded";
  }
  const auto dashboard = make_dashboard();
  env.registered = false;
  ASSERT_TRUE(until([&] { return env.registered; }, env, *dashboard));
  EXPECT_EQ(env.newest, 5u) << "it knows what it has";
  dashboard->recorder.finish(true);
  env.spin();
  EXPECT_TRUE(env.left);
}

TEST_F(RecorderTest, AFullStoreAcknowledgesNothingSaysSoAndGoesOnWhenThereIsSpace) {
  ScriptedEnvironment env;
  store_options_.most_bytes = 400'000;
  const auto dashboard = make_dashboard();
  // An old run, to be removed when space is needed.
  msg::RunInfo old = run_info(0, 400, 1, 1, kJob - 1);
  old.ended(true);
  dashboard->store.record(old);
  std::vector<msg::EpisodeStat> past = episodes(1, 500, "env-past");
  for (msg::EpisodeStat& one : past) one.run_id(kJob - 1);
  dashboard->store.record(past);
  ASSERT_TRUE(until(
      [&] {
        if (env.kept.empty()) env.finish_episodes(300);
        return dashboard->recorder.failing();
      },
      env, *dashboard));
  EXPECT_TRUE(dashboard->told("nothing is recorded"));
  const int acknowledgements = env.acknowledgements;
  const std::int64_t recorded = number("SELECT COUNT(*) FROM episodes") - 500;
  const Clock::time_point later = Clock::now() + milliseconds(200);
  ASSERT_TRUE(until([&] { return Clock::now() >= later; }, env, *dashboard));
  EXPECT_TRUE(dashboard->recorder.failing());
  EXPECT_EQ(env.acknowledgements, acknowledgements);
  EXPECT_EQ(env.acknowledged, static_cast<std::uint64_t>(recorded));
  EXPECT_EQ(dashboard->events.size(), 1u) << "said once";

  ASSERT_EQ(dashboard->store.remove(run_id(old)), Store::Removal::kDone);
  ASSERT_TRUE(until([&] { return env.kept.empty(); }, env, *dashboard));
  EXPECT_FALSE(dashboard->recorder.failing());
  EXPECT_TRUE(dashboard->told("recording again"));
  EXPECT_EQ(number("SELECT COUNT(*) FROM episodes"), static_cast<std::int64_t>(env.episodes));
  EXPECT_EQ(dashboard->store.events(10).size(), 2u);
}

TEST_F(RecorderTest, AsksForUpdatesThatDidNotCome) {
  ScriptedLearner learner;
  const auto dashboard = make_dashboard();
  learner.last = 1000;
  learner.say(1000);
  ASSERT_TRUE(until([&] { return number("SELECT COUNT(*) FROM training") == 1000; }, learner, *dashboard));
  const int requests = learner.requests;
  EXPECT_GE(requests, 8);
  EXPECT_LE(requests, 16);
  // From now on they come by themselves, but for one.
  learner.last = 1010;
  for (std::uint64_t update = 1001; update <= 1010; ++update)
    if (update != 1005) learner.send(update);
  ASSERT_TRUE(until([&] { return number("SELECT COUNT(*) FROM training") == 1010; }, learner, *dashboard));
  EXPECT_EQ(learner.requests, requests + 1);
}

TEST_F(RecorderTest, AfterARestartItAsksOnlyForWhatIsMissing) {
  ScriptedLearner learner;
  learner.last = 300;
  learner.say(300);
  {
    const auto dashboard = make_dashboard();
    ASSERT_TRUE(until([&] { return number("SELECT COUNT(*) FROM training") == 300; }, learner, *dashboard));
  }
  learner.requests = 0;
  learner.last = 310;
  learner.say(310);
  const auto dashboard = make_dashboard();
  ASSERT_TRUE(until([&] { return number("SELECT COUNT(*) FROM training") == 310; }, learner, *dashboard));
  EXPECT_EQ(learner.requests, 1);
}

TEST_F(RecorderTest, GivesUpUpdatesThatNobodyHas) {
  ScriptedLearner learner;
  const auto dashboard = make_dashboard();
  learner.first = 101;  // resumed there
  learner.last = 150;
  learner.say(150);
  ASSERT_TRUE(until([&] { return number("SELECT COUNT(*) FROM training") == 50; }, learner, *dashboard));
  const int enough = learner.requests + 5;
  ASSERT_TRUE(until([&] { return learner.requests >= enough - 1; }, learner, *dashboard));
  const Clock::time_point later = Clock::now() + milliseconds(300);
  ASSERT_TRUE(until([&] { return Clock::now() >= later; }, learner, *dashboard));
  EXPECT_LE(learner.requests, enough);
}

TEST_F(RecorderTest, UpdatesThatWereGivenUpAreRecordedWhenTheyCome) {
  ScriptedLearner learner;
  const auto dashboard = make_dashboard();
  learner.last = 50;
  learner.say(1'000'000'000);  // a wrong number: nobody has these
  ASSERT_TRUE(until([&] { return number("SELECT COUNT(*) FROM training") == 50; }, learner, *dashboard));
  const int all = learner.requests + 5;
  ASSERT_TRUE(until([&] { return learner.requests >= all; }, learner, *dashboard));
  ASSERT_TRUE(until(
      [&] {
        learner.send(51);
        return number("SELECT COUNT(*) FROM training") == 51;
      },
      learner, *dashboard));
}

TEST_F(RecorderTest, ARunStaysWithItsProcessWhileThatLives) {
  auto learner = std::make_unique<ScriptedLearner>();
  const auto dashboard = make_dashboard();
  learner->last = 10;
  learner->say(10);
  const auto rows = [&] { return number("SELECT COUNT(*) FROM training"); };
  ASSERT_TRUE(until([&] { return rows() == 10; }, *learner, *dashboard));
  // Another process says that it goes on with this run, from its beginning.
  ScriptedLearner stranger;
  stranger.say(0);
  stranger.last = 1;
  stranger.send(1);
  ASSERT_TRUE(until([&] { return dashboard->node.traffic.rejected > 0; }, *learner, stranger, *dashboard));
  learner->say(10);
  ASSERT_TRUE(until([&] { return dashboard->told("another process announces run"); }, *learner, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(DISTINCT incarnation) FROM training"), 1);
  EXPECT_EQ(rows(), 10);
  learner->last = 11;
  learner->send(11);
  ASSERT_TRUE(until([&] { return rows() == 11; }, *learner, *dashboard));
  // Once it is silent, its successor goes on.
  learner.reset();
  stranger.first = stranger.last = 8;
  ASSERT_TRUE(until(
      [&] {
        stranger.say(8);
        return rows() == 8;
      },
      stranger, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(DISTINCT incarnation) FROM training"), 2);
}

TEST_F(RecorderTest, KnowsRunsAndWhatEnvironmentsHost) {
  ScriptedEnvironment env;
  ScriptedLearner learner;
  const auto dashboard = make_dashboard();
  learner.say(0);
  msg::TraversalInfo info = traversal_info();
  env.node.publish(info);
  env.finish_episodes(10);
  ASSERT_TRUE(
      until([&] { return env.kept.empty() && number("SELECT COUNT(*) FROM sources WHERE dataset = 'synthetic'"); }, env,
            learner, *dashboard));
  StoreReader reader(store_options_.path);
  const auto run = reader.run("demo/policy/1/1700000000000000");
  ASSERT_TRUE(run);
  EXPECT_EQ(run->recorded, 10u);
  EXPECT_EQ(reader.traversals(run->id).size(), 1u);
  EXPECT_FALSE(run->ended);
  EXPECT_TRUE(dashboard->told("place_filter, seed 1 begins"));
  learner.node.report(msg::STOPPING, "stopping");
  EXPECT_TRUE(until([&] { return reader.run(run->name)->ended; }, learner, *dashboard));
}

}  // namespace
}  // namespace citylearn::testing
