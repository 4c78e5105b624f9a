// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/best_checkpoint.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/files.h"

namespace citylearn::testing {
namespace {

Checkpoint of(std::uint64_t update, double spl, std::uint64_t episodes = 100, int lesson = 0) {
  Checkpoint checkpoint;
  checkpoint.header = {
      {"agent", "nobody"},
      {"progress", {{"updates", update}, {"lesson_episodes", episodes}, {"lesson", lesson}, {"spl", spl}}}};
  return checkpoint;
}

std::uint64_t kept(const BestCheckpoint& best) {
  return read_checkpoint(best.path()).header.at("progress").at("updates").get<std::uint64_t>();
}

struct BestCheckpointTest : ::testing::Test {
  const Folder folder;
  BestCheckpoint best{folder.path()};
};

TEST_F(BestCheckpointTest, KeepsTheHighestSplAndOfEqualOnesTheLatest) {
  best.consider(of(1, 1.0, 99));
  EXPECT_FALSE(best.figures()) << "too few episodes";
  EXPECT_FALSE(std::filesystem::exists(best.path()));
  best.consider(of(2, 0.7));
  best.consider(of(3, 0.9));
  best.consider(of(4, 0.2));
  EXPECT_EQ(kept(best), 3u);
  best.consider(of(5, 0.9));
  EXPECT_EQ(kept(best), 5u);
  EXPECT_EQ(best.figures()->spl(), 0.9);
}

TEST_F(BestCheckpointTest, PrefersALaterLesson) {
  best.consider(of(1, 0.9, 200, 0));
  best.consider(of(2, 1.0, 99, 1));
  EXPECT_EQ(kept(best), 1u) << "still of the lesson before";
  best.consider(of(3, 0.3, 100, 1));
  EXPECT_EQ(kept(best), 3u);
}

TEST_F(BestCheckpointTest, EvaluationsDecideWhereThereAreAny) {
  best.consider(of(1, 0.9, 200, 1));
  best.consider(BestCheckpoint::evaluated(of(2, 0.3, 50, 0), 0.4));
  EXPECT_EQ(kept(best), 2u) << "also early in the first lesson";
  best.consider(of(3, 0.95, 200, 1));
  EXPECT_EQ(kept(best), 2u) << "was not evaluated";
  best.consider(BestCheckpoint::evaluated(of(4, 0.95, 200, 1), 0.3));
  EXPECT_EQ(kept(best), 2u);
  best.consider(BestCheckpoint::evaluated(of(5, 0.5, 200, 1), 0.6));
  EXPECT_EQ(kept(best), 5u);
  const BestCheckpoint next(folder.path());
  ASSERT_TRUE(next.figures());
  EXPECT_EQ(next.figures()->spl(), 0.6);
  EXPECT_EQ(next.figures()->training_spl, 0.5);
  EXPECT_EQ(next.figures()->description(), "update 5, SPL 0.600 in evaluation");
}

TEST_F(BestCheckpointTest, IsKnownAgainByTheNextProcess) {
  BestCheckpoint(folder.path()).consider(of(7, 0.9));
  BestCheckpoint next(folder.path());
  ASSERT_TRUE(next.figures());
  EXPECT_EQ(next.figures()->update, 7u);
  next.consider(of(8, 0.5));
  EXPECT_EQ(kept(next), 7u);
}

TEST_F(BestCheckpointTest, ReplacesAFileThatCannotBeRead) {
  make_file(folder / "best.clk", "not a checkpoint");
  BestCheckpoint next(folder.path());
  EXPECT_FALSE(next.figures());
  next.consider(of(1, 0.1));
  EXPECT_EQ(kept(next), 1u);
}

}  // namespace
}  // namespace citylearn::testing
