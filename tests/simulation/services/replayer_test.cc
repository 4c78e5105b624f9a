// SPDX-License-Identifier: Apache-2.0
// Recording what is said in a process, and playing it to the dashboard's recorder.
#include "core/recording/replayer.h"

#include <gtest/gtest.h>

#include "dashboard/store/database.h"
#include "dashboard/store/recorder.h"
#include "dashboard/store/store_reader.h"
#include "tests/support/options.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/recordings.h"
#include "tests/support/records/records.h"
#include "tests/support/records/samples.h"
#include "tests/support/text.h"
#include "tests/support/wait.h"
#include "tools/record/recording.h"

namespace citylearn::testing {
namespace {

constexpr std::uint64_t kStart = 1'700'000'000'000'000'000, kSecond = 1'000'000'000, kMillisecond = 1'000'000;

std::unique_ptr<Middleware> middleware(std::uint32_t domain, const std::string& name = "inprocess") {
  return create_middleware(middleware_options(name, domain, "test"));
}

/// A dashboard without a page, as dashboard/main.cc makes one.
class Watcher {
 public:
  Watcher(std::uint32_t domain, const std::string& path)
      : store({path, 0}), node(options(domain)), recorder(node, store) {}
  void spin() {
    const auto hand_on = [this](auto message) {
      while (node.take(message)) recorder.on_message(message);
    };
    hand_on(msg::ServiceStatus());
    hand_on(msg::TraversalInfo());
    hand_on(msg::RunInfo());
    hand_on(msg::TrainingStat());
    recorder.poll();
  }
  static Node::Options options(std::uint32_t domain) {
    return {middleware_options("inprocess", domain), "dashboard", "dashboard", ""};
  }
  Store store;
  Node node;
  citylearn::Recorder recorder;
};

/// Until all is played; false when it never is.
bool play(Middleware& wire, Replayer& replayer, Watcher* watcher = nullptr) {
  const auto turn = [&] {
    if (watcher) watcher->spin();
    wire.wait(std::min(replayer.due(), Clock::now() + std::chrono::milliseconds(2)));
  };
  const bool played = eventually(
      turn, [&] { return !replayer.poll(); }, std::chrono::seconds(60));
  if (watcher) watcher->spin();
  return played;
}

/// A policy_service of `updates` updates, and two env_services of `episodes` episodes each.
void write_run(const std::string& path, std::uint64_t updates, std::uint64_t episodes) {
  Tape tape(path);
  std::uint64_t time = kStart;
  for (const std::string environment : {"env-a", "env-b"}) {
    tape.say(heartbeat("env_service", environment, 7), time);
    tape.say(traversal_info(environment), time);
  }
  for (std::uint64_t i = 1; i <= std::max(updates, episodes); ++i) {
    time += kMillisecond;
    if (i % 100 == 1) tape.say(run_info(std::min(i, updates), 500, i), time);
    if (i <= updates) tape.say(training_stat(i), time);
    if (i > episodes) continue;
    tape.say(episode(i, "env-a"), time);
    tape.say(episode(i, "env-b"), time);
  }
  tape.say(run_info(updates, 500, episodes + updates), time);
}

std::int64_t count(const std::string& store, const std::string& what) {
  return open_database(store).execAndGet("SELECT COUNT(*) FROM " + what).getInt64();
}

struct ReplayTest : ::testing::Test {
  const Folder folder;
  const std::string tape_path = folder / "a.mcap", store_path = folder / "a.sqlite";
};

TEST_F(ReplayTest, ARecorderGetsEverythingAtAnySpeed) {
  write_run(tape_path, 200, 1000);
  const auto wire = middleware(30);
  Watcher watcher(30, store_path);
  Replayer replayer(*wire, {{tape_path}, 0, {}, ""});
  ASSERT_TRUE(play(*wire, replayer, &watcher));
  EXPECT_EQ(watcher.recorder.recorded(), 2000u);
  EXPECT_EQ(count(store_path, "episodes"), 2000);
  EXPECT_EQ(count(store_path, "training"), 200);
  EXPECT_EQ(replayer.figures().played.at("citylearn/episode_stat"), 2000u);
  EXPECT_EQ(replayer.figures().remarks, std::vector<std::string>());
  EXPECT_EQ(replayer.figures().skipped.size(), 0u);
  EXPECT_NEAR(replayer.figures().seconds, 1.0, 1e-3);

  // Once more, it is known; as another run, it is not.
  Replayer again(*wire, {{tape_path}, 0, {"episode_stat", "run_info", "service_status"}, "again"});
  ASSERT_TRUE(play(*wire, again, &watcher));
  EXPECT_EQ(count(store_path, "episodes"), 4000);
  EXPECT_EQ(StoreReader(store_path).runs().size(), 2u);
}

TEST_F(ReplayTest, WhatIsLostIsPlayedAgain) {
  write_run(tape_path, 100, 300);
  const auto wire = middleware(31, "lossy,drop=0.1,seed=3:inprocess");
  Watcher watcher(31, store_path);
  Replayer replayer(*wire, {{tape_path}, 0, {}, ""});
  ASSERT_TRUE(play(*wire, replayer, &watcher));
  EXPECT_EQ(count(store_path, "episodes"), 600);
  EXPECT_EQ(count(store_path, "training"), 100);
  EXPECT_GT(replayer.figures().repeated, 20u);
}

TEST_F(ReplayTest, ARecordingMayBeginInTheMiddleOfATraining) {
  {
    Tape tape(tape_path);
    tape.say(run_info(300), kStart);
    for (std::uint64_t update = 50; update <= 300; ++update) tape.say(training_stat(update), kStart);
  }
  const auto wire = middleware(29, "lossy,drop=0.1,seed=3:inprocess");
  Watcher watcher(29, store_path);
  Replayer replayer(*wire, {{tape_path}, 0, {}, ""});
  ASSERT_TRUE(play(*wire, replayer, &watcher));
  EXPECT_EQ(count(store_path, "training"), 251);
  EXPECT_EQ(replayer.figures().remarks, std::vector<std::string>());
}

TEST_F(ReplayTest, AnEpisodeThatWasNotRecordedHoldsNobodyUp) {
  {
    Tape tape(tape_path);
    for (std::uint64_t i = 1; i <= 400; ++i)
      if (i != 10) tape.say(episode(i), kStart);
  }
  const auto wire = middleware(32);
  Watcher watcher(32, store_path);
  Replayer replayer(*wire, {{tape_path}, 0, {}, ""});
  ASSERT_TRUE(play(*wire, replayer, &watcher));
  EXPECT_EQ(count(store_path, "episodes"), 399);
  ASSERT_FALSE(replayer.figures().remarks.empty());
  EXPECT_EQ(replayer.figures().remarks[0],
            "'dashboard' has not recorded episode 11 of 'env-summer' and is not waited for any more");
}

/// 300 episodes as they may be recorded of an env_service that keeps the last 20: each pair the wrong way round, 20, 30
/// and so on to 290 twice, but 10 not at all and 50 after all others.
void write_disorder(const std::string& path) {
  Tape tape(path);
  const auto say = [&](std::uint64_t number) {
    msg::EpisodeStat stat = episode(number);
    stat.log().first(number > 20 ? number - 20 : 1);
    tape.say(stat, kStart);
  };
  for (std::uint64_t pair = 1; pair <= 299; pair += 2) {
    for (const std::uint64_t number : {pair + 1, pair})
      if (number != 10 && number != 50) say(number);
    if (pair > 20 && pair % 10 == 1 && pair != 51) say(pair - 1);
  }
  say(50);
}

TEST_F(ReplayTest, RecordsThatAreMissingLateOrThereTwiceAreRecordedOnce) {
  write_disorder(tape_path);
  std::uint32_t domain = 44;
  for (const std::string name : {"inprocess", "lossy,drop=0.1,repeat=0.1,reorder=0.1,seed=3:inprocess"}) {
    const auto wire = middleware(++domain, name);
    const std::string file = folder / std::to_string(domain) + ".sqlite";
    Watcher watcher(domain, file);
    Replayer replayer(*wire, {{tape_path}, 0, {}, ""});
    ASSERT_TRUE(play(*wire, replayer, &watcher));
    SCOPED_TRACE(name);
    EXPECT_EQ(count(file, "episodes WHERE episode <> 50"), 298);
    // By then it is acknowledged, as one that never comes, and so is not sent again where it is lost.
    EXPECT_LE(count(file, "episodes WHERE episode = 50"), 1);
    EXPECT_TRUE(name != "inprocess" || count(file, "episodes WHERE episode = 50") == 1);
    EXPECT_EQ(watcher.store.recorded_up_to(Sender("demo", "env-summer", 7)), 300u) << "the tenth never comes";
    EXPECT_EQ(replayer.figures().played.at("citylearn/episode_stat"), 299u + 27);
    EXPECT_EQ(replayer.figures().remarks, std::vector<std::string>());
  }
}

TEST_F(ReplayTest, GoesOnWhereNobodyListensAndIntoTheNextFile) {
  write_run(tape_path, 5, 5);
  write_run(folder / "b.mcap", 5, 5);
  std::string file = contents(folder / "b.mcap");
  make_file(folder / "b.mcap", file.substr(0, file.size() - 100));
  const auto wire = middleware(33);
  Replayer replayer(*wire, {{tape_path, folder / "b.mcap"}, 0, {}, ""});
  ASSERT_TRUE(play(*wire, replayer));
  EXPECT_EQ(replayer.figures().played.at("citylearn/episode_stat"), 20u);
  ASSERT_EQ(replayer.figures().remarks.size(), 1u);
  EXPECT_TRUE(contains(replayer.figures().remarks[0], "b.mcap: cut short after "));
  EXPECT_NEAR(replayer.figures().seconds, 0.010, 1e-3) << "the second follows at once";
}

TEST_F(ReplayTest, TakesTheTimeThatItTook) {
  {
    Tape tape(tape_path);
    for (std::uint64_t i = 0; i <= 4; ++i) tape.say(heartbeat("env_service", "env", 7), kStart + i * kSecond / 8);
  }
  const auto wire = middleware(34);
  const auto seconds = [&](double speed) {
    const Clock::time_point begin = Clock::now();
    Replayer replayer(*wire, {{tape_path}, speed, {}, ""});
    while (replayer.figures().played.empty() || replayer.figures().played.begin()->second < 5) {
      replayer.poll();
      wire->wait(replayer.due());
    }
    return std::chrono::duration<double>(Clock::now() - begin).count();
  };
  EXPECT_GE(seconds(4), 0.125);
  EXPECT_GE(seconds(1), 0.5);
}

TEST_F(ReplayTest, ClocksThatAreSetHoldNobodyUp) {
  {
    Tape tape(tape_path);
    const std::uint64_t hour = 3600 * kSecond;
    for (const std::uint64_t time : {kStart, kStart + kSecond, kStart + 5 * hour, kStart + 5 * hour + kSecond,
                                     kStart - hour, kStart - hour + kSecond, std::uint64_t{1}, ~std::uint64_t{0}})
      tape.say(heartbeat("env_service", "env", 7), time);
  }
  const auto wire = middleware(39);
  const Clock::time_point begin = Clock::now();
  Replayer replayer(*wire, {{tape_path}, 50, {}, ""});
  ASSERT_TRUE(play(*wire, replayer));
  EXPECT_EQ(replayer.figures().played.at("citylearn/service_status"), 8u);
  EXPECT_NEAR(replayer.figures().seconds, 3 + 10 + 10, 1e-3) << "three seconds and two leaps of ten";
  EXPECT_GE(Clock::now() - begin, milliseconds(23'000 / 50));
  ASSERT_EQ(replayer.figures().remarks.size(), 1u);
  EXPECT_EQ(replayer.figures().remarks[0],
            tape_path + ": its clock leaps 4 times; a leap ahead is played as 10 s, one back as none");
}

TEST_F(ReplayTest, SendsAMapAgainToWhomAsksForIt) {
  msg::RouteMapChunk map;
  sign(map.header(), "env-summer", 7);
  map.receiver("dashboard-of-then");
  map.hash(0xABC);
  map.total_bytes(3);
  map.data({1, 2, 3});
  Tape(tape_path).say(map, kStart);
  const auto wire = middleware(37);
  Replayer replayer(*wire, {{tape_path}, 0, {}, ""});
  ASSERT_TRUE(play(*wire, replayer));
  Node node(Watcher::options(37));
  node.create_reader_at<msg::RouteMapChunk>("dashboard", "demo");
  msg::RouteMapChunk taken;
  msg::RouteMapRequest request;
  request.server("env-summer");
  request.hash(0xABD);
  request.items({0});
  node.publish(request, "demo");
  replayer.poll();
  EXPECT_FALSE(node.take(taken)) << "of another traversal there is none";
  request.hash(0xABC);
  node.publish(request, "demo");
  replayer.poll();
  ASSERT_TRUE(node.take(taken));
  EXPECT_EQ(taken.data(), map.data());
}

TEST_F(ReplayTest, TellsWhatItLeavesOut) {
  {
    Tape tape(tape_path);
    const std::string name = topic_of<msg::Scene>().name;
    const Bytes scene = encoded(sample_of<msg::Scene>(Size::kTypical));
    Bytes old = scene;
    old[4] = std::byte{3};
    const auto same = tape.writer.add({name, "citylearn::msg::Scene", "omgidl", "", "cdr", {}});
    tape.writer.write(same, 1, scene);
    tape.writer.write(same, 1, old);
    tape.writer.write(same, 1, Bytes(3));
    tape.writer.write(tape.writer.add({name, "citylearn::msg::Action", "omgidl", "", "cdr", {}}), 1, scene);
    tape.writer.write(tape.writer.add({"rosout", "rcl_interfaces/msg/Log", "ros2msg", "", "cdr", {}}), 1, scene);
  }
  const auto wire = middleware(35);
  Replayer replayer(*wire, {{tape_path}, 0, {"scene"}, ""});
  ASSERT_TRUE(play(*wire, replayer));
  EXPECT_EQ(replayer.figures().played, (std::map<std::string, std::uint64_t>{{"citylearn/scene", 1}}));
  EXPECT_EQ(replayer.figures().skipped,
            (std::map<std::string, std::uint64_t>{
                {"of protocol 3, not " + std::to_string(msg::PROTOCOL), 1},
                {"topic citylearn/scene has 'citylearn::msg::Action' as 'cdr' instead of 'citylearn::msg::Scene' as "
                 "'cdr'",
                 1},
                {"topic citylearn/scene: not readable", 1},
                {"topic rosout is none of ours", 1}}));
  EXPECT_THROW(Replayer(*wire, {{tape_path}, 0, {"scenery"}, ""}), Error);
  EXPECT_THROW(Replayer(*wire, {{folder / "none.mcap"}, 0, {}, ""}), Error);
}

TEST_F(ReplayTest, RecordingCountsWhatItMissed) {
  const auto wire = middleware(38), other = middleware(38);
  Recording recording(*wire, {tape_path, "", {"episode_stat", "run_info"}, 0, "test"});
  const auto episodes = other->create_publisher(topic_of<msg::EpisodeStat>());
  const auto runs = other->create_publisher(topic_of<msg::RunInfo>());
  // Numbers of two senders, one of them heard from the fifth on; late ones are none that were missed.
  for (const std::uint64_t number : {1, 2, 5, 6, 4, 9}) episodes->publish(encoded(episode(number, "env-a")));
  for (const std::uint64_t number : {5, 6, 8}) episodes->publish(encoded(episode(number, "env-b")));
  for (const std::uint64_t number : {1, 9}) runs->publish(encoded(run_info(1, 500, number)));
  recording.close();
  EXPECT_EQ(recording.counts().at("citylearn/episode_stat").messages, 9u);
  EXPECT_EQ(recording.counts().at("citylearn/episode_stat").missed, 5u);
  EXPECT_EQ(recording.counts().at("citylearn/run_info").missed, 0u);
}

TEST_F(ReplayTest, RecordingKeepsTheBytesOfItsRunInParts) {
  const auto wire = middleware(36), other = middleware(36);
  Recording recording(*wire, {tape_path, "demo", {}, 20000, "test"});
  std::map<std::string, std::vector<Bytes>> said;
  for_each_message([&]<class Message>() {
    const auto publisher = other->create_publisher(topic_of<Message>());
    for (int i = 0; i < 3; ++i) {
      Message message = sample_of<Message>(Size::kTypical);
      message.header().session(i == 1 ? "another" : "demo");
      message.header().message(static_cast<std::uint64_t>(i));
      publisher->publish(encoded(message));
      if (i != 1) said[topic_of<Message>().name].push_back(encoded(message));
    }
    recording.poll();
  });
  const auto undecodable = other->create_publisher(topic_of<msg::Scene>());
  undecodable->publish(Bytes(3));
  said[topic_of<msg::Scene>().name].emplace_back(3);
  recording.close();

  EXPECT_EQ(recording.other_sessions(), all_topics().size());
  ASSERT_GT(recording.files().size(), 1u);
  EXPECT_EQ(recording.files()[1], folder / "a-2.mcap");
  std::map<std::string, std::vector<Bytes>> read;
  for (const std::string& file : recording.files())
    for (const Heard& heard : all_of(file)) read[heard.topic].push_back(heard.bytes);
  EXPECT_EQ(read, said);
  EXPECT_EQ(recording.counts().at("citylearn/scene").messages, 3u);
  EXPECT_THROW(Recording(*wire, {folder / "b.mcap", "", {"scenery"}, 0, ""}), Error);
}

}  // namespace
}  // namespace citylearn::testing
