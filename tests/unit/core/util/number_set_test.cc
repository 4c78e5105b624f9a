// SPDX-License-Identifier: Apache-2.0
#include "core/util/number_set.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace citylearn {
namespace {

TEST(NumberSet, IsTheSetOfItsNumbers) {
  std::mt19937 random(3);
  NumberSet set;
  std::vector<bool> plain(200, false);
  for (int i = 0; i < 400; ++i) {
    const std::uint64_t first = 1 + random() % 199;
    if (i % 5 == 0) {
      const std::uint64_t last = std::min<std::uint64_t>(199, first + random() % 4);
      set.add(first, last);
      std::fill(plain.begin() + static_cast<std::ptrdiff_t>(first),
                plain.begin() + static_cast<std::ptrdiff_t>(last) + 1, true);
    } else {
      EXPECT_EQ(set.add(first), !plain[first]);
      plain[first] = true;
    }
    std::uint64_t reach = 0;
    while (reach + 1 < 200 && plain[reach + 1]) ++reach;
    ASSERT_EQ(set.reach(), reach);
    ASSERT_EQ(set.count(1, 199), static_cast<std::uint64_t>(std::count(plain.begin(), plain.end(), true)));
  }
}

TEST(NumberSet, LosesItsEndAndTakesInOthers) {
  NumberSet set, more;
  set.add(1, 5);
  set.add(8, 9);
  set.remove_from(4);
  EXPECT_EQ(set.reach(), 3u);
  EXPECT_EQ(set.count(1, 100), 3u);
  more.add(4);
  more.add(7, 8);
  set.add(more);
  EXPECT_EQ(set.reach(), 4u);
  EXPECT_EQ(set.count(1, 100), 6u);
  set.remove_from(1);
  EXPECT_EQ(set.count(1, 100), 0u);
}

TEST(RecordedNumbers, GoOnAfterAWrongWordOfWhatWillNeverCome) {
  RecordedNumbers numbers;
  numbers.give_up(1, 3);
  EXPECT_TRUE(numbers.record(4));
  EXPECT_EQ(numbers.settled().reach(), 4u);
  EXPECT_TRUE(numbers.record(7)) << "5 and 6 are on their way";
  numbers.give_up(1, 1'000'000'000'000);
  EXPECT_EQ(numbers.settled().reach(), 1'000'000'000'000u);
  EXPECT_TRUE(numbers.record(5)) << "it comes all the same";
  EXPECT_EQ(numbers.settled().reach(), 5u);
  EXPECT_TRUE(numbers.record(6));
  EXPECT_EQ(numbers.settled().reach(), 7u);
  EXPECT_FALSE(numbers.record(6));
}

}  // namespace
}  // namespace citylearn
