// SPDX-License-Identifier: Apache-2.0
#include "env_service/traversal/traversal.h"

#include <gtest/gtest.h>

#include <limits>
#include <set>

#include "tests/support/env/env.h"

namespace citylearn::testing {
namespace {

TEST(TraversalHash, DependsOnDataAndDatasetButNotOnTheName) {
  const Traversal original = small_traversal(10);
  std::set<std::uint64_t> hashes{original.hash()};
  Traversal other = original;
  other.name = "another";
  other.condition = "night";
  EXPECT_EQ(other.hash(), original.hash());
  const auto differs = [&](auto change) {
    Traversal changed = original;
    change(changed);
    return hashes.insert(changed.hash()).second;
  };
  EXPECT_TRUE(differs([](Traversal& t) { t.dataset = "x"; }));
  EXPECT_TRUE(differs([](Traversal& t) { t.features[7] += 0.001f; }));
  EXPECT_TRUE(differs([](Traversal& t) { t.positions[3] = 0.5f; }));
  EXPECT_TRUE(differs([](Traversal& t) { t.positions[3] = std::numeric_limits<float>::quiet_NaN(); }));
  EXPECT_TRUE(differs([](Traversal& t) { std::swap(t.frames, t.dimension); }));
}

// Computed by another program (SHA-256 of: length and text of the dataset, F, D, count and floats twice; all
// little-endian).
TEST(TraversalHash, IsTheSameForEver) {
  Traversal traversal;
  traversal.dataset = "plain";
  traversal.frames = 2;
  traversal.dimension = 1;
  traversal.features = {1.0f, 2.0f};
  traversal.positions = {0.0f, 10.0f};
  EXPECT_EQ(traversal.hash(), 0xC9DD9672F109FEDDull);
}

}  // namespace
}  // namespace citylearn::testing
