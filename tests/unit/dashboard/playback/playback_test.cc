// SPDX-License-Identifier: Apache-2.0
#include "dashboard/playback/playback.h"

#include <gtest/gtest.h>

#include <thread>

#include "tests/support/files.h"
#include "tests/support/records/recordings.h"
#include "tests/support/records/records.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

constexpr std::uint32_t kPlaybackDomain = 39;
constexpr std::uint64_t kSecond = 1'000'000'000;

TEST(Playback, IsOnItsWayUntilWhatWasPlayedIsShown) {
  const Folder folder;
  const std::string file = folder / "a.mcap";
  {
    Tape tape(file);
    for (std::uint64_t i = 0; i <= 4; ++i)
      tape.say(heartbeat("env_service", "env", 7), 1'700'000'000 * kSecond + i * kSecond);
  }
  const Timeline timeline({file});
  Playback playback(kPlaybackDomain, {{file}, 1, {}, "", 1.5, true}, 0, timeline);
  const auto arrives = [&] {
    return eventually([] { std::this_thread::yield(); }, [&] { return playback.arrived().has_value(); });
  };

  ASSERT_TRUE(arrives());
  EXPECT_TRUE(playback.state().seeking);
  EXPECT_EQ(playback.state().position, 1.5);
  const std::uint64_t first = *playback.arrived();
  playback.show(first);
  EXPECT_FALSE(playback.state().seeking);
  EXPECT_EQ(playback.arrived(), std::nullopt);

  PlaybackChange later;
  later.position = 3;
  playback.change(later);
  playback.show(first);  // of before
  EXPECT_TRUE(playback.state().seeking);
  ASSERT_TRUE(arrives());
  playback.show(*playback.arrived());
  EXPECT_FALSE(playback.state().seeking);

  PlaybackChange earlier;
  earlier.position = 2;
  playback.change(earlier);
  EXPECT_TRUE(playback.state().seeking);
  EXPECT_EQ(playback.arrived(), std::nullopt) << "another playback goes there";
  ASSERT_TRUE(playback.restart());
}

TEST(Playback, AtTheBeginningNothingIsOnItsWay) {
  const Folder folder;
  const std::string file = folder / "a.mcap";
  Tape(file).say(heartbeat("env_service", "env", 7), kSecond);
  const Timeline timeline({file});
  const Playback playback(kPlaybackDomain, {{file}, 1, {}, "", 0, true}, 0, timeline);
  EXPECT_FALSE(playback.state().seeking);
  EXPECT_EQ(playback.arrived(), std::nullopt);
}

}  // namespace
}  // namespace citylearn::testing
