// SPDX-License-Identifier: Apache-2.0
// Work that is done once.
#include "tools/paper/work.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "core/util/error.h"
#include "tests/support/processes/service.h"

namespace citylearn::paper {
namespace {

using citylearn::testing::Folder;

class WorkTest : public ::testing::Test {
 protected:
  /// Counts how often it is done.
  Unit counted(int number) {
    return {"unit", {{"number", number}}, 1, [this, number] {
              ++times;
              return Json(number * number);
            }};
  }
  static Json fail() { throw Error("cannot be done"); }

  const Folder folder;
  Work work{folder / "work"};
  int times = 0;
};

TEST_F(WorkTest, IsDoneOnceAndFoundAgain) {
  work.add(counted(3));
  work.add(counted(3));
  const int four = work.add(counted(4));
  EXPECT_EQ(work.units(), 2);
  EXPECT_TRUE(work.run());
  EXPECT_EQ(work.outcome(four), 16);
  Work again(folder / "work");
  const int three = again.add(counted(3));
  again.add(counted(5));
  EXPECT_TRUE(again.run());
  EXPECT_EQ(times, 3);
  EXPECT_EQ(again.outcome(three), 9);
}

TEST_F(WorkTest, WhatFailsOrIsDamagedIsDoneAgain) {
  const int bad = work.add({"bad", {{"bad", 1}}, 1, fail}), two = work.add(counted(2));
  EXPECT_FALSE(work.run());
  EXPECT_TRUE(work.outcome(bad).is_null());
  EXPECT_EQ(work.outcome(two), 4) << "the others go on";
  for (const auto& file : std::filesystem::directory_iterator(folder / "work")) std::ofstream(file.path()) << "{\"half";
  Work again(folder / "work");
  again.add(counted(2));
  EXPECT_TRUE(again.run());
  EXPECT_EQ(times, 2);
}

TEST_F(WorkTest, WhatAnotherRunHasDoneMeanwhileIsNotDoneAgain) {
  const auto other_run = [&]() -> Json {
    Work other(folder / "work");
    other.add(counted(3));
    EXPECT_TRUE(other.run());
    return 1;
  };
  work.add({"slow", {{"slow", 1}}, 1, other_run});
  const int three = work.add(counted(3));
  EXPECT_TRUE(work.run());
  EXPECT_EQ(times, 1);
  EXPECT_EQ(work.outcome(three), 9);
}

TEST_F(WorkTest, ResultsAreWithoutWhatTheMachineDecides) {
  const Json outcome = {{"seconds", 3}, {"rows", {{{"spl", 0.5}, {"seconds", {1, 2}}}, nullptr, 7}}};
  EXPECT_EQ(repeatable(outcome), (Json{{"rows", {{{"spl", 0.5}}, nullptr, 7}}}));
  work.add({"timed", {{"timed", 1}}, 1, [&] { return Json{{"seconds", ++times}, {"spl", 1}}; }});
  work.add({"bad", {{"bad", 1}}, 1, fail});
  EXPECT_FALSE(work.run());
  const Json results = Json::parse(work.results());
  ASSERT_EQ(results.size(), 2u);
  EXPECT_EQ(results[0], (Json{{"name", "timed"}, {"spec", {{"timed", 1}}}, {"outcome", {{"spl", 1}}}}));
  EXPECT_TRUE(results[1]["outcome"].is_null());
  EXPECT_TRUE(work.times()[0]["seconds"].is_number());
  EXPECT_TRUE(work.times()[1]["seconds"].is_null());
}

}  // namespace
}  // namespace citylearn::paper
