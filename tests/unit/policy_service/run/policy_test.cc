// SPDX-License-Identifier: Apache-2.0
// The policy_service's parts that need no wire: scores, records, files, controls.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "core/files/files.h"
#include "core/task/state_map.h"
#include "core/util/error.h"
#include "core/util/random.h"
#include "policy_service/distributed/heartbeat_thread.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/records/episode_log.h"
#include "policy_service/records/metrics_log.h"
#include "policy_service/records/run_announcer.h"
#include "policy_service/results/score.h"
#include "policy_service/rollout/control.h"
#include "policy_service/run/policy_service.h"
#include "tests/support/networks/some_agent.h"
#include "tests/support/options.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/episodes_csv.h"
#include "tests/support/text.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

msg::EpisodeStat episode(std::uint64_t number, std::uint32_t shortest = 1, std::uint32_t steps = 1,
                         bool completed = true) {
  msg::EpisodeStat e;
  e.header().sender() = "env-summer";
  e.header().incarnation() = 7;
  e.log().number() = number;
  e.log().first() = 1;
  e.traversal() = "summer";
  e.shortest() = shortest;
  e.steps() = steps;
  e.completed() = completed;
  e.reward() = completed ? 1.0f : -1.0f;
  return e;
}

TEST(Score, IsWhatItsNamesSay) {
  const Score s =
      score({episode(1, 10, 10, true), episode(2, 10, 20, true), episode(3, 40, 128, false), episode(4, 4, 16, true)});
  EXPECT_EQ(s.tasks, 4);
  EXPECT_DOUBLE_EQ(s.completed, 0.75);
  EXPECT_DOUBLE_EQ(s.spl, (1 + 0.5 + 0 + 0.25) / 4);
  EXPECT_DOUBLE_EQ(s.excess, (1 + 2 + 4) / 3.0);
  EXPECT_DOUBLE_EQ(s.mean_steps, (10 + 20 + 128 + 16) / 4.0);
  EXPECT_DOUBLE_EQ(s.shortest_mean, 16);
  EXPECT_DOUBLE_EQ(s.reward, 0.5);
}

TEST(Score, OfNothingAndOfFailuresIsFinite) {
  EXPECT_EQ(score({}).tasks, 0);
  const Score s = score({episode(1, 10, 128, false)});
  EXPECT_EQ(s.spl, 0);
  EXPECT_EQ(s.excess, 0);
}

struct EpisodeLogTest : ::testing::Test {
  const Folder folder;
  const std::string path = folder / "episodes.csv";
};

TEST_F(EpisodeLogTest, RecordsOnceWhateverTheOrder) {
  EpisodeLog log(path);
  EXPECT_TRUE(log.record(episode(2)));
  EXPECT_EQ(log.recorded("env-summer", 7), 0u);
  EXPECT_TRUE(log.record(episode(1)));
  EXPECT_EQ(log.recorded("env-summer", 7), 2u);
  EXPECT_FALSE(log.record(episode(2)));
  EXPECT_TRUE(log.record(episode(4)));
  EXPECT_EQ(log.recorded("env-summer", 7), 2u) << "3 is missing";
  EXPECT_TRUE(log.has_gap("env-summer", 7));
  EXPECT_FALSE(log.has_gap("env-summer", 8));
  EXPECT_EQ(log.recorded("env-summer", 8), 0u) << "another incarnation";
  EXPECT_EQ(log.total(), 3u);
}

TEST_F(EpisodeLogTest, WritesEpisodesInTheirOrder) {
  {
    EpisodeLog log(path);
    for (const std::uint64_t number : {1, 3, 4, 6}) EXPECT_TRUE(log.record(episode(number)));
    EXPECT_EQ(log.recorded("env-summer", 7), 1u);
    EXPECT_EQ(csv_rows(path).size(), 1u) << "if the env_service dies before it sends 2 again, nothing has a gap";
    EXPECT_TRUE(log.record(episode(2)));
    EXPECT_EQ(log.recorded("env-summer", 7), 4u);
    EXPECT_EQ(csv_rows(path).size(), 4u);
    log.skip(episode(5));
    EXPECT_EQ(log.recorded("env-summer", 7), 6u);
    EXPECT_TRUE(log.record(episode(8)));
  }
  std::vector<std::string> numbers;
  for (const auto& row : csv_rows(path)) numbers.push_back(row.at(2));
  EXPECT_EQ(numbers, (std::vector<std::string>{"1", "2", "3", "4", "6"}));
  EXPECT_TRUE(EpisodeLog(path).record(episode(8))) << "it was never recorded";
}

TEST_F(EpisodeLogTest, TakesUpWhereTheEnvironmentWasAcknowledged) {
  EpisodeLog log("");
  msg::EpisodeStat late = episode(58);
  late.log().first() = 58;
  EXPECT_TRUE(log.record(late));
  EXPECT_EQ(log.recorded("env-summer", 7), 58u);
}

TEST_F(EpisodeLogTest, HasNoRowsOfWhatItPassesOver) {
  EpisodeLog log(path);
  log.skip(episode(1));
  EXPECT_TRUE(log.record(episode(3)));
  log.skip(episode(2));
  EXPECT_EQ(log.recorded("env-summer", 7), 3u) << "nothing is missing";
  EXPECT_FALSE(log.record(episode(2)));
  EXPECT_EQ(log.total(), 1u);
  EXPECT_EQ(lines_of(read_file(path)).size(), 2u);
}

TEST_F(EpisodeLogTest, SurvivesAKillInTheMiddleOfARow) {
  {
    EpisodeLog log(path);
    log.record(episode(1));
    log.record(episode(2));
    log.recorded("env-summer", 7);
  }
  std::string text = read_file(path);
  const std::size_t whole = text.size();
  std::ofstream(path, std::ios::app) << "env-summer,7,3,0,su";
  EpisodeLog log(path);
  EXPECT_EQ(log.total(), 2u);
  EXPECT_EQ(fs::file_size(path), whole);
  EXPECT_FALSE(log.record(episode(2)));
  EXPECT_TRUE(log.record(episode(3)));
}

TEST_F(EpisodeLogTest, TakesNamesOfAnyCharactersBack) {
  for (const char* name : {"a,b", "two\nlines", "say \"hi\"", "a,1,2\nb"}) {
    msg::EpisodeStat one = episode(1);
    one.header().sender() = name;
    one.traversal() = name;
    EXPECT_TRUE(EpisodeLog(path).record(one)) << name;
    EXPECT_FALSE(EpisodeLog(path).record(one)) << name << " is there already";
  }
  EXPECT_EQ(EpisodeLog(path).total(), 4u);
}

TEST_F(EpisodeLogTest, RefusesAForeignFile) {
  std::ofstream(path) << "name,price\nbread,3\n";
  EXPECT_TRUE(contains(error_of([&] { EpisodeLog log(path); }), path));
  EXPECT_EQ(read_file(path), "name,price\nbread,3\n");
}

TEST(MetricsLog, ForgetsWhatCameAfterTheCheckpoint) {
  Folder folder;
  const std::string path = folder / "metrics.csv";
  {
    MetricsLog log(path, 0);
    for (std::uint64_t update = 1; update <= 5; ++update) {
      msg::TrainingStat stat;
      stat.update() = update;
      stat.wall() = static_cast<double>(update) * 2;
      log.write(stat);
    }
  }
  std::ofstream(path, std::ios::app) << "6,1";
  MetricsLog log(path, 3);
  EXPECT_DOUBLE_EQ(log.wall(), 6);
  EXPECT_EQ(lines_of(read_file(path)).size(), 4u);
}

/// Two nodes in this process.
class RunAnnouncerTest : public ::testing::Test {
 protected:
  static Node::Options options(const std::string& id) {
    return {middleware_options("inprocess"), id, id, "run-record-" + std::to_string(getpid())};
  }
  RunAnnouncerTest() {
    watcher.create_reader<msg::RunInfo>();
    watcher.create_reader<msg::TrainingStat>();
    watcher.create_writer<msg::TrainingAcknowledgement>();
  }
  /// Lets the record work until nothing more comes; all stats that came.
  std::vector<msg::TrainingStat> stats(RunAnnouncer& record) {
    std::vector<msg::TrainingStat> found;
    record.handle();
    while (watcher.take(stat)) found.push_back(stat);
    return found;
  }
  bool take_info() {
    bool any = false;
    while (watcher.take(info)) any = true;
    return any;
  }
  void acknowledge(std::uint64_t number, std::uint64_t job = 5) {
    msg::TrainingAcknowledgement acknowledgement;
    acknowledgement.writer() = "policy";
    acknowledgement.writer_incarnation() = policy.incarnation();
    acknowledgement.stream() = job;
    acknowledgement.number() = number;
    watcher.publish(acknowledgement);
  }
  Node policy{options("policy")}, watcher{options("watcher")};
  msg::TrainingStat stat;
  msg::RunInfo info;
};

TEST_F(RunAnnouncerTest, AnnouncesTheRunFromItsStartToItsEnd) {
  RunAnnouncer record(policy, {"place_filter", "ppo", 3, 5, 20, "{\"a\": 1}"});
  ASSERT_TRUE(take_info());
  EXPECT_EQ(std::string(info.agent().c_str()), "place_filter");
  EXPECT_EQ(std::string(info.learner().c_str()), "ppo");
  EXPECT_EQ(info.seed(), 3u);
  EXPECT_EQ(info.run_id(), 5u);
  EXPECT_EQ(info.updates(), 20u);
  EXPECT_FALSE(info.ended());
  EXPECT_EQ(std::string(info.manifest().begin(), info.manifest().end()), "{\"a\": 1}");
  record.handle();
  EXPECT_FALSE(take_info()) << "not all the time";
  const auto turn = [&] {
    policy.wait(Clock::now() + milliseconds(20));
    record.handle();
  };
  EXPECT_TRUE(eventually(turn, [&] { return take_info(); }));
  EXPECT_EQ(info.header().message(), 2u) << "again after a while";
  record.end();
  ASSERT_TRUE(take_info());
  EXPECT_TRUE(info.ended());
  RunAnnouncer large(policy, {"place_filter", "", 3, 6, 0, std::string(msg::MAX_CHUNK + 1, ' ')});
  ASSERT_TRUE(take_info());
  EXPECT_TRUE(info.manifest().empty()) << "what does not fit is left out";
}

TEST_F(RunAnnouncerTest, SendsItsStatsAgainToReadersThatLackThem) {
  RunAnnouncer record(policy, {"place_filter", "ppo", 3, 5, 20, ""});
  const auto expect_stat = [](const msg::TrainingStat& one, std::uint64_t number) {
    EXPECT_EQ(one.log().stream(), 5u);
    EXPECT_EQ(one.log().number(), number);
    EXPECT_EQ(one.log().first(), 1u);
    EXPECT_EQ(one.update(), 20 + 3 * number);
    EXPECT_EQ(one.reward(), static_cast<float>(number) / 2);
    EXPECT_EQ(one.wall(), static_cast<double>(number) * 3);
    EXPECT_EQ(std::string(one.header().sender().c_str()), "policy");
  };
  for (std::uint64_t number = 1; number <= 400; ++number) {
    msg::TrainingStat one;
    one.update() = 20 + 3 * number;  // the other ranks made those between
    one.reward() = static_cast<float>(number) / 2;
    one.wall() = static_cast<double>(number) * 3;
    record.add(one);
    const auto came = stats(record);
    ASSERT_EQ(came.size(), 1u);
    expect_stat(came[0], number);
  }
  EXPECT_TRUE(stats(record).empty());
  EXPECT_FALSE(record.reader_expected()) << "nobody reads";
  // One that comes late gets all, as fast as it acknowledges.
  acknowledge(0);
  std::uint64_t has = 0;
  while (has < 400) {
    const auto came = stats(record);
    ASSERT_FALSE(came.empty());
    ASSERT_LE(came.size(), 64u);
    for (const msg::TrainingStat& one : came) expect_stat(one, ++has);
    EXPECT_TRUE(record.reader_expected());
    acknowledge(has);
  }
  EXPECT_TRUE(stats(record).empty());
  EXPECT_FALSE(record.reader_expected());
  acknowledge(398);
  EXPECT_EQ(stats(record).size(), 2u) << "it has lost some";
  acknowledge(400);
  acknowledge(30, 6);
  EXPECT_TRUE(stats(record).empty()) << "another run";
  const std::uint64_t rejected = policy.traffic.rejected;
  acknowledge(401);
  EXPECT_TRUE(stats(record).empty());
  EXPECT_EQ(policy.traffic.rejected, rejected + 1) << "it was not made";
}

TEST_F(RunAnnouncerTest, AHeartBeatsWhileTheNodesThreadComputes) {
  watcher.create_reader<msg::ServiceStatus>();
  HeartbeatThread heart(policy);
  msg::ServiceStatus status;
  int beats = 0;
  // Work that ends when two heartbeats were heard, a second apart.
  const bool heard = heart.run([&] {
    return eventually([&] { watcher.wait(Clock::now() + milliseconds(20)); },
                      [&] {
                        while (watcher.take(status)) beats += status.header().sender() == "policy";
                        return beats >= 2;
                      });
  });
  EXPECT_TRUE(heard);
  policy.report(msg::RUNNING, "its own again");
  EXPECT_TRUE(poll_until(
      [&] {
        while (watcher.take(status))
          if (status.activity() == "its own again") return true;
        return false;
      },
      kMaxWait));
}

TEST(Files, AFailedWriteLeavesTheOldFile) {
  Folder folder;
  const std::string path = folder / "file";
  citylearn::write_file(path, "old");
  fs::create_directory(path + "." + std::to_string(::getpid()) + ".tmp");  // in the way of the temporary file
  EXPECT_THROW(citylearn::write_file(path, "new"), Error);
  EXPECT_EQ(read_file(path), "old");
}

msg::Observation observation(int position, int goal, std::uint8_t flags, int frames, std::uint8_t previous) {
  msg::Observation o;
  o.frame() = {static_cast<std::uint32_t>(position)};
  o.position() = {static_cast<std::uint32_t>(position)};
  o.goal() = {static_cast<std::uint32_t>(goal)};
  o.flags() = {flags};
  o.previous_action() = {previous};
  o.allowed() = {static_cast<std::uint8_t>(1 | (position + 1 < frames ? 2 : 0) | (position > 0 ? 4 : 0))};
  return o;
}

int walk(Policy& policy, int first, int frames, int position, int goal, const Matrix<float>& features) {
  std::vector<std::uint8_t> choice;
  std::uint8_t flags = msg::FLAG_FIRST, previous = kNoAction;
  for (int step = 0; step < 4 * frames; ++step) {
    if (position == goal) return step;
    msg::Observation o = observation(position, goal, flags, frames, previous);
    for (auto* field : {&o.frame(), &o.position(), &o.goal()}) field->at(0) += static_cast<std::uint32_t>(first);
    o.feature_dimension() = static_cast<std::uint32_t>(features.rows());
    if (features.size() > 0) o.features().assign(features.col(position).begin(), features.col(position).end());
    policy.act(o, choice);
    EXPECT_TRUE(o.allowed()[0] >> choice.at(0) & 1);
    previous = choice[0];
    position = StateMap(frames).after(position, previous, 1);
    flags = 0;
  }
  return -1;
}

TEST(Options, WhatTrainingBeginsWithIsForTrainingAlone) {
  const auto refusal = [](const PolicyServiceOptions& options) { return error_of([&] { checked_options(options); }); };
  PolicyServiceOptions options;
  options.initial_checkpoint = "agent.clk";
  options.frozen = {"head"};
  EXPECT_EQ(refusal(options), "agent.clk: No such file or directory") << "the options are right";
  options.mode = "evaluate";
  options.checkpoint = "agent.clk";
  EXPECT_TRUE(contains(refusal(options), "--initial: is for --mode train"));
  options.initial_checkpoint.clear();
  EXPECT_TRUE(contains(refusal(options), "--freeze: is for --mode train"));
  options.mode = "train";
  EXPECT_TRUE(contains(refusal(options), "--initial")) << "the way to train a checkpoint's agent further";
}

TEST(Options, EachExperienceIsAnotherTraversal) {
  const auto refusal = [](const PolicyServiceOptions& options) { return error_of([&] { checked_options(options); }); };
  PolicyServiceOptions options;
  options.train = {"summer", "fall"};
  EXPECT_EQ(refusal(options), "");
  options.role = "learner";
  EXPECT_EQ(refusal(options),
            "--role learner: learns from one traversal, not from summer, fall (train on several with --role both)");
  options.role = "both";
  options.train.push_back("summer");
  EXPECT_EQ(refusal(options), "--train: names 'summer' twice");
  options.train = {""};  // as of a variable of the shell that is not set
  EXPECT_EQ(refusal(options), "--train: names no traversal");
  options.train = {"summer"};
  options.evaluate = {"fall", ""};
  EXPECT_EQ(refusal(options), "--evaluate: names no traversal");
}

TEST(Options, LessonsEndAtAnyNumberOfPlaces) {
  PolicyServiceOptions options;
  options.curriculum = true;
  for (const int frames : {2, 100, 128, 512}) {
    options.frames = frames;
    EXPECT_EQ(error_of([&] { checked_options(options); }), "") << frames;
  }
}

ControlTask some_control_task(int first, int frames, int dimension) {
  Random random(3);
  ControlTask task{first, frames, Matrix<float>(dimension, frames)};
  for (float& value : task.reference.reshaped()) value = static_cast<float>(random.normal());
  return task;
}

TEST(Controls, EachReachesItsGoalOnARouteThatBeginsAnywhere) {
  const int frames = 24, dimension = 8, first = 5;
  ControlTask task = some_control_task(first, frames, dimension);
  ASSERT_EQ(ControlRegistry::instance().entries().size(), 4u);
  for (const auto* entry : ControlRegistry::instance().entries()) {
    const auto policy = entry->create(Parameters(entry->name, entry->parameters, {}), task);
    for (int start : {0, 3, 12, 23})
      for (int goal : {0, 1, 11, 12, 22, 23}) {
        const int steps = walk(*policy, first, frames, start, goal, task.reference);
        ASSERT_GE(steps, 0) << entry->name << ": " << start << " -> " << goal;
        if (entry->name != "blind") {
          EXPECT_EQ(steps, std::abs(goal - start)) << entry->name;
        }
      }
  }
}

/// The pictures look like the second experience of the route, and nothing like the first.
TEST(Controls, SequenceFilterRemembersEachExperience) {
  const int frames = 24, dimension = 8;
  ControlTask task = some_control_task(0, frames, dimension);
  const Matrix<float> winter = task.reference.rowwise().reverse();
  task.reference.conservativeResize(Eigen::NoChange, 2 * frames);
  Random random{4};
  for (float& value : task.reference.leftCols(frames).reshaped()) value = static_cast<float>(random.normal());
  task.reference.rightCols(frames) = winter;
  const auto& entry = ControlRegistry::instance().find("control", "sequence_filter");
  const auto policy = entry.create(Parameters(entry.name, entry.parameters, {}), task);
  for (int goal : {0, 11, 23})
    for (int start : {2, 12, 20})
      EXPECT_EQ(walk(*policy, 0, frames, start, goal, winter), std::abs(goal - start)) << start << " -> " << goal;
}

TEST(Controls, BlindTurnsRoundAtTheEnd) {
  const auto& entry = ControlRegistry::instance().find("control", "blind");
  const auto policy = entry.create(Parameters(), ControlTask{0, 24});
  EXPECT_EQ(walk(*policy, 0, 24, 2, 5, {}), 2 + 5) << "goal in the lower half: first to the beginning";
  EXPECT_EQ(walk(*policy, 0, 24, 20, 15, {}), 3 + 8) << "goal in the upper half: first to the end";
}

TEST(Controls, SequenceFilterNamesAMissingReference) {
  const auto& entry = ControlRegistry::instance().find("control", "sequence_filter");
  EXPECT_THROW(entry.create(Parameters(entry.name, entry.parameters, {}), ControlTask{0, 24}), Error);
}

}  // namespace
}  // namespace citylearn::testing
