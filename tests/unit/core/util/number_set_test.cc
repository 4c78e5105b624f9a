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
    const auto gap = set.gap(199);
    ASSERT_EQ(gap.has_value(), reach < 199);
    if (!gap) continue;
    EXPECT_EQ(gap->first, reach + 1);
    for (std::uint64_t n = gap->first; n <= gap->second; ++n) EXPECT_FALSE(plain[n]);
    if (gap->second < 199) {
      EXPECT_TRUE(plain[gap->second + 1]);
    }
  }
}

}  // namespace
}  // namespace citylearn
