// SPDX-License-Identifier: Apache-2.0
// Work that is done once.
#include "tools/paper/work.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "core/util/error.h"
#include "tests/support/service.h"

namespace citylearn::paper {
namespace {

using citylearn::testing::Folder;

Unit counted(int number, int& times) {
  return {"unit", {{"number", number}}, 1, [&times, number] {
            ++times;
            return Json(number * number);
          }};
}

TEST(Work, IsDoneOnceAndFoundAgain) {
  const Folder folder;
  int times = 0;
  {
    Work work(folder / "work");
    work.add(counted(3, times));
    work.add(counted(3, times));
    work.add(counted(4, times));
    EXPECT_EQ(work.units(), 2);
    EXPECT_TRUE(work.run());
    EXPECT_EQ(work.outcome({{"number", 4}}), 16);
  }
  Work again(folder / "work");
  again.add(counted(3, times));
  again.add(counted(5, times));
  EXPECT_TRUE(again.run());
  EXPECT_EQ(times, 3);
  EXPECT_EQ(again.outcome({{"number", 3}}), 9);
  EXPECT_TRUE(again.outcome({{"number", 4}}).is_null()) << "not asked for by this run";
}

TEST(Work, WhatFailsOrIsDamagedIsDoneAgain) {
  const Folder folder;
  int times = 0;
  {
    Work work(folder / "work");
    work.add({"bad", {{"bad", 1}}, 1, []() -> Json { throw Error("cannot be done"); }});
    work.add(counted(2, times));
    EXPECT_FALSE(work.run());
    EXPECT_TRUE(work.outcome({{"bad", 1}}).is_null());
    EXPECT_EQ(work.outcome({{"number", 2}}), 4) << "the others go on";
  }
  for (const auto& file : std::filesystem::directory_iterator(folder / "work")) std::ofstream(file.path()) << "{\"half";
  Work again(folder / "work");
  again.add(counted(2, times));
  EXPECT_TRUE(again.run());
  EXPECT_EQ(times, 2);
}

TEST(Work, WhatIsCompleteStaysWhenItStops) {
  const Folder folder;
  int times = 0;
  {
    Work work(folder / "work");
    work.add(counted(2, times));
    work.add({"stopped", {{"stopped", 1}}, 1, []() -> Json { throw Stopped{}; }});
    EXPECT_THROW(work.run(), Stopped);
  }
  Work again(folder / "work");
  again.add(counted(2, times));
  EXPECT_TRUE(again.run());
  EXPECT_EQ(times, 1);
}

TEST(Work, WhatAnotherRunHasDoneMeanwhileIsNotDoneAgain) {
  const Folder folder;
  int times = 0;
  const auto other_run = [&]() -> Json {
    Work other(folder / "work");
    other.add(counted(3, times));
    EXPECT_TRUE(other.run());
    return 1;
  };
  Work work(folder / "work");
  work.add({"slow", {{"slow", 1}}, 1, other_run});
  work.add(counted(3, times));
  EXPECT_TRUE(work.run());
  EXPECT_EQ(times, 1);
  EXPECT_EQ(work.outcome({{"number", 3}}), 9);
}

TEST(Work, ResultsAreWithoutWhatTheMachineDecides) {
  const Json outcome = {
      {"seconds", 3}, {"rows", {{{"spl", 0.5}, {"seconds", {1, 2}}}, nullptr, 7}}, {"bytes", {{"a", 1}}}};
  EXPECT_EQ(repeatable(outcome), (Json{{"rows", {{{"spl", 0.5}}, nullptr, 7}}}));
  const Folder folder;
  Work work(folder / "work");
  int times = 0;
  work.add({"timed", {{"timed", 1}}, 1, [&] { return Json{{"seconds", ++times}, {"spl", 1}}; }});
  work.add({"bad", {{"bad", 1}}, 1, []() -> Json { throw Error("cannot be done"); }});
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
