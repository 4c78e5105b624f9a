// The policy_service's parts that need no wire: scores, records, files, controls.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "core/files.h"
#include "core/random.h"
#include "policy_service/control.h"
#include "policy_service/episode_log.h"
#include "policy_service/metrics_log.h"
#include "policy_service/score.h"
#include "tests/support/service.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

using testing::Folder;

msg::EpisodeStat episode(std::uint64_t number, std::uint32_t shortest, std::uint32_t steps, bool completed) {
  msg::EpisodeStat e;
  e.header().sender() = "env-summer";
  e.header().incarnation() = 7;
  e.episode() = number;
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

TEST(EpisodeLog, RecordsOnceWhateverTheOrder) {
  Folder folder;
  EpisodeLog log(folder / "episodes.csv");
  EXPECT_TRUE(log.record(episode(2, 1, 1, true)));
  EXPECT_EQ(log.recorded("env-summer", 7), 0u);
  EXPECT_TRUE(log.record(episode(1, 1, 1, true)));
  EXPECT_EQ(log.recorded("env-summer", 7), 2u);
  EXPECT_FALSE(log.record(episode(2, 1, 1, true)));
  EXPECT_TRUE(log.record(episode(4, 1, 1, true)));
  EXPECT_EQ(log.recorded("env-summer", 7), 2u) << "3 is missing";
  EXPECT_EQ(log.recorded("env-summer", 8), 0u) << "another incarnation";
  EXPECT_EQ(log.total(), 3u);
}

TEST(EpisodeLog, TakesUpWhereTheEnvironmentWasAcknowledged) {
  EpisodeLog log("");
  msg::EpisodeStat late = episode(58, 1, 1, true);
  late.acknowledged() = 57;
  EXPECT_TRUE(log.record(late));
  EXPECT_EQ(log.recorded("env-summer", 7), 58u);
}

TEST(EpisodeLog, SurvivesAKillInTheMiddleOfARow) {
  Folder folder;
  const std::string path = folder / "episodes.csv";
  {
    EpisodeLog log(path);
    log.record(episode(1, 1, 1, true));
    log.record(episode(2, 1, 1, true));
    log.recorded("env-summer", 7);
  }
  std::string text = read_file(path);
  const std::size_t whole = text.size();
  std::ofstream(path, std::ios::app) << "env-summer,7,3,0,su";
  EpisodeLog log(path);
  EXPECT_EQ(log.total(), 2u);
  EXPECT_EQ(fs::file_size(path), whole);
  EXPECT_FALSE(log.record(episode(2, 1, 1, true)));
  EXPECT_TRUE(log.record(episode(3, 1, 1, true)));
}

TEST(EpisodeLog, RefusesAForeignFile) {
  Folder folder;
  const std::string path = folder / "episodes.csv";
  std::ofstream(path) << "name,price\nbread,3\n";
  try {
    EpisodeLog log(path);
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find(path), std::string::npos);
  }
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
  std::ifstream in(path);
  std::string line;
  int rows = 0;
  while (std::getline(in, line)) ++rows;
  EXPECT_EQ(rows, 4);
}

TEST(Files, AFailedWriteLeavesTheOldFile) {
  Folder folder;
  const std::string path = folder / "file";
  write_file(path, "old");
  fs::create_directory(path + "." + std::to_string(::getpid()) + ".tmp");  // in the way of the temporary file
  EXPECT_THROW(write_file(path, "new"), Error);
  EXPECT_EQ(read_file(path), "old");
}

TEST(Files, ANamedErrorForAMissingFolder) {
  EXPECT_THROW(write_file("/nonexistent/folder/file", "x"), Error);
  EXPECT_THROW(read_file("/nonexistent/file"), Error);
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

int walk(Policy& policy, int first, int frames, int position, int goal, const std::vector<float>& features,
         int dimension) {
  std::vector<std::uint8_t> choice;
  std::uint8_t flags = msg::FLAG_FIRST, previous = kNoAction;
  for (int step = 0; step < 4 * frames; ++step) {
    if (position == goal) return step;
    msg::Observation o = observation(position, goal, flags, frames, previous);
    for (auto* field : {&o.frame(), &o.position(), &o.goal()}) field->at(0) += static_cast<std::uint32_t>(first);
    o.feature_dimension() = static_cast<std::uint32_t>(dimension);
    o.features().assign(features.begin() + position * dimension, features.begin() + (position + 1) * dimension);
    policy.act(o, choice);
    EXPECT_TRUE(o.allowed()[0] >> choice.at(0) & 1);
    previous = choice[0];
    position += previous == kNext ? 1 : previous == kPrevious ? -1 : 0;
    flags = 0;
  }
  return -1;
}

TEST(Controls, EachReachesItsGoalOnARouteThatBeginsAnywhere) {
  const int frames = 24, dimension = 8, first = 5;
  Random random(3);
  ControlTask task{first, frames, dimension, {}};
  for (int i = 0; i < frames * dimension; ++i) task.reference.push_back(static_cast<float>(random.normal()));
  ASSERT_EQ(ControlRegistry::instance().entries().size(), 3u);
  for (const auto* entry : ControlRegistry::instance().entries()) {
    const auto policy = entry->create(Parameters(entry->name, entry->parameters, {}), task);
    for (int start : {0, 3, 12, 23})
      for (int goal : {0, 1, 11, 12, 22, 23}) {
        const int steps = walk(*policy, first, frames, start, goal, task.reference, dimension);
        ASSERT_GE(steps, 0) << entry->name << ": " << start << " -> " << goal;
        if (entry->name != "blind") {
          EXPECT_EQ(steps, std::abs(goal - start)) << entry->name;
        }
      }
  }
}

TEST(Controls, BlindTurnsRoundAtTheEnd) {
  const auto& entry = ControlRegistry::instance().find("control", "blind");
  const auto policy = entry.create(Parameters(), ControlTask{0, 24, 0, {}});
  EXPECT_EQ(walk(*policy, 0, 24, 2, 5, {}, 0), 2 + 5) << "goal in the lower half: first to the beginning";
  EXPECT_EQ(walk(*policy, 0, 24, 20, 15, {}, 0), 3 + 8) << "goal in the upper half: first to the end";
}

TEST(Controls, SequenceFilterNamesAMissingReference) {
  const auto& entry = ControlRegistry::instance().find("control", "sequence_filter");
  EXPECT_THROW(entry.create(Parameters(entry.name, entry.parameters, {}), ControlTask{0, 24, 0, {}}), Error);
}

}  // namespace
}  // namespace citylearn
