// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/ranges.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/util/error.h"
#include "tests/support/data/scans.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class Ranges : public ::testing::Test {
 protected:
  std::vector<float> of(const std::vector<std::array<float, 3>>& returns, int bins) const {
    write_scan(path_, returns);
    return nearest_ranges(path_, bins);
  }

  Folder folder_;
  std::string path_ = folder_ / "0.bin";
};

constexpr float kNone = kMaxRange;

TEST_F(Ranges, BinsBeginBehindAndTurnLeft) {
  EXPECT_EQ(of({{-10, -1, 0}}, 4)[0], std::hypot(10.0f, 1.0f));
  EXPECT_EQ(of({{1, -10, 0}}, 4)[1], std::hypot(10.0f, 1.0f));
  EXPECT_EQ(of({{10, 1, 0}}, 4)[2], std::hypot(10.0f, 1.0f));
  EXPECT_EQ(of({{-1, 10, 0}}, 4)[3], std::hypot(10.0f, 1.0f));
  // Straight behind is both ends of the turn.
  EXPECT_EQ(of({{-10, 0.0f, 0}}, 4)[0], 10);
  EXPECT_EQ(of({{-10, -0.0f, 0}}, 4)[0], 10);
  EXPECT_EQ(of({{0, 7, 0}, {0, -8, 0}}, 1), std::vector<float>{7});
}

TEST_F(Ranges, AreThoseOfTheNearestReturn) {
  EXPECT_EQ(of({{20, 1, 0}, {0, 9, 0}, {6, 8, 0.5}, {30, 40, 0}}, 2), (std::vector<float>{kNone, 9}));
  EXPECT_EQ(of({{6, 8, 0.9f}}, 2)[1], 10);  // the height does not count
}

TEST_F(Ranges, RoadRoofTreesAndWhatIsFarAreNone) {
  EXPECT_EQ(of({{5, 1, -1.7f}, {5, 1, 1.5f}, {2, 1, 0}, {90, 1, 0}}, 2), (std::vector<float>{kNone, kNone}));
  EXPECT_EQ(of({}, 3), std::vector<float>(3, kNone));
}

TEST_F(Ranges, TellWhatIsBroken) {
  const auto complaint = [&] { return error_of([&] { nearest_ranges(path_, 4); }); };
  EXPECT_TRUE(holds(complaint(), "0.bin")) << complaint();
  make_file(path_, std::string(20, 'x'));
  EXPECT_TRUE(holds(complaint(), "0.bin: is not a laser scan: 20 bytes")) << complaint();
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    write_scan(path_, {{5, 5, 0}, {5, bad, 0}});
    EXPECT_TRUE(holds(complaint(), "0.bin: return 1 has a place that is not finite")) << complaint();
  }
}

}  // namespace
}  // namespace citylearn::testing
