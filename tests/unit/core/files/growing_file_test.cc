// SPDX-License-Identifier: Apache-2.0
// Files that grow by whole records on a disk that is full for a while, and the log of episodes on top of them.
#include "core/files/growing_file.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>

#include "core/files/files.h"
#include "core/recording/mcap_writer.h"
#include "policy_service/records/episode_log.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// While it lives, no file of this process grows beyond so many bytes: a disk that is full.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) {
    ::signal(SIGXFSZ, SIG_IGN);
    ::getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes, before_.rlim_max};
    EXPECT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
  }
  ~FullDisk() { ::setrlimit(RLIMIT_FSIZE, &before_); }

 private:
  rlimit before_{};
};

msg::EpisodeStat numbered_episode(std::uint64_t number) {
  msg::EpisodeStat stat;
  stat.header().sender() = "env-summer";
  stat.header().incarnation() = 7;
  stat.log().number() = number;
  stat.log().first() = 1;
  stat.traversal() = "summer";
  return stat;
}

TEST(McapWriter, LeavesNoRecordingThatHasNoRoomToBegin) {
  const Folder folder;
  const FullDisk full(20);
  EXPECT_TRUE(contains(error_of([&] { McapWriter(folder / "x.mcap", {}); }), "cannot be written: File too large"));
  EXPECT_FALSE(std::filesystem::exists(folder / "x.mcap"));
}

TEST(GrowingFile, WhatFindsNoRoomWaitsAndNoPartOfARecordIsEverThere) {
  const Folder folder;
  const std::string path = folder / "log";
  GrowingFile file(path);
  file.add("one\n");
  EXPECT_TRUE(file.flush());
  {
    const FullDisk full(11);
    file.add("two\n");
    file.add("three\n");
    file.add("four\n");
    EXPECT_FALSE(file.flush());
    EXPECT_TRUE(contains(file.problem(), path + ": File too large"));
    EXPECT_EQ(contents(path), "one\ntwo\n") << "as many as fit, and no part of the third";
    EXPECT_EQ(file.waiting(), 11u);
    file.add("five\n");
    EXPECT_FALSE(file.flush());
    EXPECT_EQ(contents(path), "one\ntwo\n");
  }
  EXPECT_TRUE(file.flush());
  EXPECT_EQ(file.problem(), "");
  EXPECT_EQ(file.waiting(), 0u);
  EXPECT_EQ(contents(path), "one\ntwo\nthree\nfour\nfive\n");
  EXPECT_EQ(file.size(), contents(path).size());
}

TEST(GrowingFile, GoesOnBehindWhatIsThereOrBeginsAnew) {
  const Folder folder;
  const std::string path = folder / "log";
  { GrowingFile(path).add("one\n"); }
  { GrowingFile(path).add("two\n"); }
  EXPECT_EQ(contents(path), "one\ntwo\n");
  { GrowingFile(path, false).add("three\n"); }
  EXPECT_EQ(contents(path), "three\n");
  EXPECT_TRUE(contains(error_of([&] { GrowingFile(folder / "nowhere/log"); }), "nowhere/log: No such file"));
}

TEST(EpisodeLog, AFullDiskAcknowledgesNothingNewAndLosesNothing) {
  const Folder folder;
  const std::string path = folder / "episodes.csv";
  EpisodeLog log(path);
  EXPECT_TRUE(log.record(numbered_episode(1)));
  EXPECT_EQ(log.recorded("env-summer", 7), 1u);
  const std::string before = contents(path);
  {
    const FullDisk full(before.size() + 10);
    EXPECT_TRUE(log.record(numbered_episode(2)));
    EXPECT_EQ(log.recorded("env-summer", 7), 1u);
    EXPECT_TRUE(contains(log.problem(), path));
    EXPECT_EQ(contents(path), before);
    EXPECT_FALSE(log.record(numbered_episode(2))) << "it waits";
    // As long as there is memory for it; then its env_service keeps it.
    std::uint64_t number = 3;
    while (log.record(numbered_episode(number)) && number < 10'000'000) ++number;
    EXPECT_LT(number, 1'000'000u);
    EXPECT_EQ(log.recorded("env-summer", 7), 1u);
  }
  const std::uint64_t recorded = log.recorded("env-summer", 7);
  EXPECT_GT(recorded, 1000u);
  EXPECT_EQ(log.problem(), "");
  EXPECT_TRUE(log.record(numbered_episode(recorded + 1))) << "sent again";
  EXPECT_EQ(log.recorded("env-summer", 7), recorded + 1);
  EXPECT_EQ(EpisodeLog(path).total(), recorded + 1) << "all of them once";
}

TEST(EpisodeLog, RowsThatTheDiskDamagedAreDroppedWithWhatFollows) {
  const Folder folder;
  const std::string path = folder / "episodes.csv";
  {
    EpisodeLog log(path);
    for (std::uint64_t number = 1; number <= 3; ++number) log.record(numbered_episode(number));
    EXPECT_EQ(log.recorded("env-summer", 7), 3u);
  }
  std::string bytes = contents(path);
  const std::size_t second = bytes.find('\n', bytes.find('\n') + 1) + 1;
  bytes.replace(second + 5, 4, 4, '\0');  // a page that did not reach the disk before the power went
  write_file(path, bytes);
  EpisodeLog log(path);
  EXPECT_EQ(log.recorded("env-summer", 7), 1u);
  EXPECT_EQ(contents(path), bytes.substr(0, second));
  EXPECT_TRUE(log.record(numbered_episode(2))) << "sent again";
}

}  // namespace
}  // namespace citylearn::testing
