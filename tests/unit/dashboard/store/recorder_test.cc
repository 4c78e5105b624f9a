// SPDX-License-Identifier: Apache-2.0
// The dashboard's recorder, against scripted services in the same process.
#include "dashboard/store/recorder.h"

#include <gtest/gtest.h>

#include <deque>

#include "core/exchange/log_sender.h"
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
      stat.log().first(acknowledged + 1);
      kept.push_back(stat);
      node.publish(kept.back());
    }
  }
  void spin() {
    node.wait(Clock::now());
    msg::EpisodeAcknowledgement message;
    while (node.take(message)) {
      if (message.writer() != node.options().id || message.writer_incarnation() != node.incarnation()) continue;
      ++acknowledgements;
      registered = true;
      left = message.state() == msg::LEAVES;
      newest = message.number();
      while (!kept.empty() && kept.front().log().number() <= message.number()) kept.pop_front();
      acknowledged = std::max<std::uint64_t>(acknowledged, message.number());
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

/// Makes figures from number `first` on, of every third update, and sends them as a LogSender decides.
class ScriptedLearner {
 public:
  explicit ScriptedLearner(std::uint64_t first = 1) : log({.keeps_all = true}, {}, first) {
    node.create_writer<msg::TrainingStat>();
    node.create_writer<msg::RunInfo>();
    node.create_reader<msg::TrainingAcknowledgement>();
  }
  void say() {
    msg::RunInfo info = run_info(log.last());
    node.publish(info);
  }
  void make(std::uint64_t updates) {
    for (std::uint64_t i = 0; i < updates; ++i) log.add();
  }
  void spin() {
    node.wait(Clock::now());
    msg::TrainingAcknowledgement message;
    while (node.take(message)) {
      if (message.writer() != node.options().id || message.writer_incarnation() != node.incarnation() ||
          message.stream() != kJob)
        continue;
      acknowledged = message.number();
      left = message.state() == msg::LEAVES;
      log.acknowledge(message, Clock::now());
    }
    for (int i = 0; i < 100; ++i) {
      const auto next = log.next(Clock::now());
      if (!next) return;
      again += next->again;
      if (next->number == lost && !next->again) continue;
      msg::TrainingStat stat = training_stat(3 * next->number);
      stat.log() = log.position(next->number, kJob);
      node.publish(stat);
    }
  }
  Node node{recorder_node_options("inprocess", "policy_service", "policy")};
  LogSender log;
  std::uint64_t lost = 0;          ///< this one does not arrive the first time
  std::uint64_t acknowledged = 0;  ///< by the newest message
  int again = 0;                   ///< sent before
  bool left = false;
};

/// A dashboard without a page: hands on what it takes.
class Dashboard {
 public:
  Dashboard(const Node::Options& options, const Store::Options& store_options)
      : node(options), store(store_options), recorder(node, store, milliseconds(50)) {
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

  RecorderTest() { store_options_.path = folder_ / "dashboard.sqlite"; }
  std::unique_ptr<Dashboard> make_dashboard(const std::string& middleware = "inprocess") {
    return std::make_unique<Dashboard>(recorder_node_options(middleware, "dashboard", "dashboard"), store_options_);
  }
  std::int64_t number(const std::string& sql) { return open_database(store_options_.path).execAndGet(sql).getInt64(); }
  template <class... Parties>
  bool until(const std::function<bool()>& condition, Parties&... parties) {
    return eventually([&] { (parties.spin(), ...); }, condition);
  }
};

TEST_F(RecorderTest, AFewWaitForOthersButNotForLong) {
  ScriptedEnvironment env;
  const auto dashboard = make_dashboard();
  ASSERT_TRUE(until([&] { return env.registered; }, env, *dashboard));
  env.finish_episodes(3);
  ASSERT_TRUE(until([&] { return env.kept.empty(); }, env, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(DISTINCT recorded) FROM episodes"), 1) << "one transaction";
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
  const msg::RunInfo old = ended(run_info(0, 400, 1, 1, kJob - 1));
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
  EXPECT_TRUE(dashboard->told("free some space"));
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

TEST_F(RecorderTest, GetsUpdatesOfBeforeItCameAndThoseThatDidNotArrive) {
  ScriptedLearner learner;
  learner.make(1000);
  while (learner.log.sent() < 1000) learner.spin();
  learner.say();
  const auto dashboard = make_dashboard();
  ASSERT_TRUE(until([&] { return learner.acknowledged == 1000; }, learner, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(*) FROM training"), 1000);
  // From now on they come by themselves, but for one.
  learner.lost = 1005;
  learner.make(10);
  ASSERT_TRUE(until([&] { return learner.acknowledged == 1010; }, learner, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(*) FROM training"), 1010);
  EXPECT_GT(dashboard->node.traffic.repeated, 0u);
}

TEST_F(RecorderTest, AfterARestartItGetsOnlyUpdatesThatAreMissing) {
  ScriptedLearner learner;
  learner.make(300);
  learner.say();
  {
    const auto dashboard = make_dashboard();
    ASSERT_TRUE(until([&] { return learner.acknowledged == 300; }, learner, *dashboard));
    dashboard->recorder.finish(false);
    learner.spin();
    EXPECT_TRUE(learner.left) << "they are kept all the same";
  }
  learner.make(10);
  learner.spin();
  learner.again = 0;
  learner.say();
  const auto dashboard = make_dashboard();
  ASSERT_TRUE(until([&] { return learner.acknowledged == 310; }, learner, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(*) FROM training"), 310);
  EXPECT_EQ(learner.again, 10);
}

TEST_F(RecorderTest, WaitsForNoUpdatesThatTheirSenderDoesNotHave) {
  ScriptedLearner learner(101);  // resumed there
  const auto dashboard = make_dashboard();
  learner.make(50);
  learner.say();
  ASSERT_TRUE(until([&] { return learner.acknowledged == 150; }, learner, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(*) FROM training"), 50);
}

TEST_F(RecorderTest, UpdatesThatWereGivenUpAreRecordedWhenTheyCome) {
  ScriptedLearner learner;
  const auto dashboard = make_dashboard();
  learner.say();
  msg::TrainingStat forged = training_stat(1'000'000'000);
  forged.log().first(forged.log().number());  // as if there were none before
  ASSERT_TRUE(until(
      [&] {
        learner.node.publish(forged);
        return number("SELECT COUNT(*) FROM training") == 1;
      },
      learner, *dashboard));
  learner.make(51);
  ASSERT_TRUE(until([&] { return learner.acknowledged == 51; }, learner, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(*) FROM training"), 52);
}

TEST_F(RecorderTest, ARunStaysWithItsProcessWhileThatLives) {
  auto learner = std::make_unique<ScriptedLearner>();
  const auto dashboard = make_dashboard();
  learner->make(10);
  learner->say();
  const auto rows = [&] { return number("SELECT COUNT(*) FROM training"); };
  ASSERT_TRUE(until([&] { return rows() == 10; }, *learner, *dashboard));
  // Another process says that it goes on with this run, from its beginning.
  ScriptedLearner stranger;
  stranger.say();
  stranger.make(1);
  ASSERT_TRUE(until([&] { return dashboard->node.traffic.rejected > 0; }, *learner, stranger, *dashboard));
  learner->say();
  ASSERT_TRUE(until([&] { return dashboard->told("another process announces run"); }, *learner, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(DISTINCT incarnation) FROM training"), 1);
  EXPECT_EQ(rows(), 10);
  learner->make(1);
  ASSERT_TRUE(until([&] { return rows() == 11; }, *learner, *dashboard));
  // Once it is silent, its successor goes on.
  learner.reset();
  stranger.log = LogSender({.keeps_all = true}, {}, 8);
  stranger.make(1);
  ASSERT_TRUE(until(
      [&] {
        stranger.say();
        return rows() == 8;
      },
      stranger, *dashboard));
  EXPECT_EQ(number("SELECT COUNT(DISTINCT incarnation) FROM training"), 2);
}

TEST_F(RecorderTest, KnowsRunsAndWhatEnvironmentsHost) {
  ScriptedEnvironment env;
  ScriptedLearner learner;
  const auto dashboard = make_dashboard();
  learner.say();
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
