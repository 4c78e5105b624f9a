// SPDX-License-Identifier: Apache-2.0
// Recordings that are paused, hurried and sent ahead.
#include "core/recording/replay_clock.h"

#include <gtest/gtest.h>

#include <thread>

#include "core/recording/outline.h"
#include "core/recording/replayer.h"
#include "tests/support/options.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/recordings.h"
#include "tests/support/records/records.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

constexpr std::uint64_t kTapeStart = 1'700'000'000'000'000'000;
constexpr std::int64_t kTapeSecond = 1'000'000'000;

/// A recording of a heartbeat at each second from 0 to 4, played into a process.
class ReplayControl : public ::testing::Test {
 protected:
  ReplayControl() {
    Tape tape(file_);
    for (std::uint64_t i = 0; i <= 4; ++i) tape.say(heartbeat("env_service", "env", 7), kTapeStart + i * kTapeSecond);
  }
  std::uint64_t played() const {
    const auto& played = replayer_->figures().played;
    return played.empty() ? 0 : played.begin()->second;
  }
  void begin(double start, bool paused) {
    replayer_ = std::make_unique<Replayer>(*wire_, ReplayOptions{{file_}, 1, {}, "", start, paused});
  }
  /// Polls until `done`; false when it is not in time.
  template <class Done>
  bool until(Done done) {
    return eventually([&] { wire_->wait(Clock::now() + std::chrono::milliseconds(2)); },
                      [&] { return replayer_->poll(), done(); }, std::chrono::seconds(20));
  }
  ReplayState state() const { return replayer_->clock().state(); }

  const Folder folder_;
  const std::string file_ = folder_ / "a.mcap";
  std::unique_ptr<Middleware> wire_ = create_middleware(middleware_options("inprocess", 38, "test"));
  std::unique_ptr<Replayer> replayer_;
};

TEST_F(ReplayControl, APausedOneGoesWhereItIsSentAndNoFurther) {
  begin(0, true);
  for (int i = 0; i < 100; ++i) replayer_->poll();
  EXPECT_EQ(played(), 0u);
  replayer_->clock().seek(2.5);
  EXPECT_TRUE(state().seeking);
  ASSERT_TRUE(until([&] { return !state().seeking; }));
  EXPECT_EQ(played(), 3u);
  EXPECT_EQ(state().position, 2.5);
  const Clock::time_point still = replayer_->clock().now();
  for (int i = 0; i < 100; ++i) replayer_->poll();
  EXPECT_EQ(replayer_->clock().now(), still) << "services are not silent because time stands still";
  replayer_->clock().seek(1);
  EXPECT_FALSE(state().seeking) << "what was played was heard";
  EXPECT_EQ(state().position, 2.5);
  EXPECT_TRUE(state().paused);

  replayer_->clock().pause(false);
  replayer_->clock().set_speed(0);
  ASSERT_TRUE(until([&] { return state().ended; }));
  EXPECT_EQ(played(), 5u);
  EXPECT_EQ(state().position, 4);
  ASSERT_TRUE(until([&] { return replayer_->clock().now() > still + std::chrono::milliseconds(1600); }))
      << "after the end time goes on, so that services become silent";
}

TEST_F(ReplayControl, BeginsAtAPosition) {
  begin(1, true);
  ASSERT_TRUE(until([&] { return !state().seeking; }));
  EXPECT_EQ(played(), 2u);
  EXPECT_EQ(state().position, 1);
  begin(100, true);
  ASSERT_TRUE(until([&] { return state().ended; })) << "beyond its end";
  EXPECT_EQ(played(), 5u);
  EXPECT_EQ(state().position, 4);
}

TEST_F(ReplayControl, GoesOnAtAnotherSpeed) {
  begin(0, false);
  replayer_->poll();
  const Clock::time_point begin = Clock::now();
  replayer_->clock().set_speed(16);
  ASSERT_TRUE(until([&] { return played() == 3; }));
  EXPECT_GE(Clock::now() - begin, std::chrono::milliseconds(2000 / 16 - 20));
  EXPECT_NEAR(state().position, 2, 0.5);
  EXPECT_LT(Clock::now() - begin, std::chrono::seconds(2)) << "as slow as before";
}

TEST_F(ReplayControl, APauseCostsNoTimeOfTheRecording) {
  ReplayClock clock;
  clock.due(0);
  const Clock::time_point due = clock.due(kTapeSecond);
  EXPECT_NEAR(std::chrono::duration<double>(due - Clock::now()).count(), 1, 0.5);
  clock.pause(true);
  EXPECT_EQ(clock.due(kTapeSecond), Clock::time_point::max());
  const double at = clock.state().position;
  const Clock::time_point later = Clock::now() + std::chrono::milliseconds(20);
  ASSERT_TRUE(eventually([] { std::this_thread::yield(); }, [&] { return Clock::now() >= later; }));
  EXPECT_EQ(clock.state().position, at);
  clock.pause(false);
  EXPECT_GT(clock.due(kTapeSecond), due);
}

TEST(RecordingOutline, CountsUpdatesAndEpisodesByPart) {
  const Folder folder;
  {
    Tape tape(folder / "a.mcap");
    tape.say(run_info(), kTapeStart);
    for (std::uint64_t i = 0; i < 10; ++i) tape.say(episode(i + 1), kTapeStart + kTapeSecond);
    tape.say(training_stat(1), kTapeStart + 50 * kTapeSecond / 10);
    tape.say(training_stat(2), kTapeStart + 10 * kTapeSecond);
  }
  const RecordingOutline outline = outline_of({folder / "a.mcap"}, {});
  EXPECT_EQ(outline.seconds, 10);
  EXPECT_EQ(outline.episodes[10], 10u);
  EXPECT_EQ(outline.updates[50], 1u);
  EXPECT_EQ(outline.updates[99], 1u) << "the last one ends the last part";
  std::uint64_t all = 0;
  for (std::size_t i = 0; i < RecordingOutline::kParts; ++i) all += outline.episodes[i] + outline.updates[i];
  EXPECT_EQ(all, 12u);

  ASSERT_EQ(outline.runs.size(), 1u);
  EXPECT_EQ(outline.runs[0].policy, "policy");
  EXPECT_EQ(outline.runs[0].seed, 1u);
  EXPECT_EQ(outline.runs[0].run_id, kJob);
  ASSERT_EQ(outline.runs[0].updates.size(), 2u);
  EXPECT_EQ(outline.runs[0].updates[0].position, 5);
  EXPECT_EQ(outline.runs[0].updates[1].steps, 1024u);
  EXPECT_EQ(outline.runs[0].updates[1].episodes, 20u);
  EXPECT_EQ(outline.runs[0].updates[1].wall, 0.5);

  const std::string whole = contents(folder / "a.mcap");
  make_file(folder / "b.mcap", whole.substr(0, 8));
  const RecordingOutline cut = outline_of({folder / "b.mcap", folder / "a.mcap"}, {});
  EXPECT_EQ(cut.seconds, 10) << "a file that is cut short has nothing";
}

TEST(RecordingOutline, HasEachUpdateOnceAndThoseOfAResumedRunAgain) {
  const Folder folder;
  {
    Tape tape(folder / "a.mcap");
    msg::TrainingStat before = training_stat(0);
    before.log() = log_position(1, kJob);
    tape.say(before, kTapeStart);
    tape.say(training_stat(1), kTapeStart);                       // a late reader gets all in a moment
    tape.say(training_stat(1, 500, 0.5f, kJob + 1), kTapeStart);  // of a run without RunInfo, which is not shown
    tape.say(run_info(), kTapeStart + kTapeSecond);
    tape.say(training_stat(2), kTapeStart + kTapeSecond);
    tape.say(training_stat(3), kTapeStart + 2 * kTapeSecond);
    tape.say(training_stat(2), kTapeStart + 3 * kTapeSecond);  // somebody had asked for it again
    tape.say(training_stat(2, 600), kTapeStart + 4 * kTapeSecond);
    tape.say(training_stat(3, 600), kTapeStart + 5 * kTapeSecond);
  }
  const RecordingOutline outline = outline_of({folder / "a.mcap"}, {});
  ASSERT_EQ(outline.runs.size(), 1u);
  std::vector<std::pair<double, std::uint64_t>> updates;
  for (const RecordedUpdate& one : outline.runs[0].updates) updates.emplace_back(one.position, one.update);
  EXPECT_EQ(updates, (std::vector<std::pair<double, std::uint64_t>>{{1, 1}, {1, 2}, {2, 3}, {4, 2}, {5, 3}}))
      << "before its RunInfo a run is not shown";
}

}  // namespace
}  // namespace citylearn::testing
