// SPDX-License-Identifier: Apache-2.0
#include "policy_service/results/pairing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "core/util/random.h"

namespace citylearn::testing {
namespace {

constexpr int kPlaces = 100, kFeatures = 32;

/// Features of places that change slowly along the street; another seed is another street.
Matrix<float> street(std::uint64_t seed) {
  Random random{seed};
  Matrix<float> all(kFeatures, 2 * kPlaces);
  for (int place = 0; place < all.cols(); ++place)
    for (int i = 0; i < kFeatures; ++i)
      all(i, place) = static_cast<float>(random.normal()) + (place > 0 ? 0.7F * all(i, place - 1) : 0);
  return all;
}

/// The frames of a drive in another light with noise: frame i is at place where(i).
Matrix<float> drive(const Matrix<float>& street, const std::function<int(int)>& where) {
  Random random{7};
  Matrix<float> frames(kFeatures, kPlaces);
  for (int i = 0; i < kPlaces; ++i)
    for (int k = 0; k < kFeatures; ++k)
      frames(k, i) = 3 + street(k, where(i)) + 0.7F * static_cast<float>(random.normal());
  return frames;
}

class PlacesApart : public ::testing::Test {
 protected:
  int of(const std::function<int(int)>& where) const {
    return places_apart(street_.leftCols(kPlaces), drive(street_, where));
  }
  const Matrix<float> street_ = street(1);
};

TEST_F(PlacesApart, IsNoneForPairsThatAreRight) {
  EXPECT_EQ(of([](int i) { return i; }), 0);
  EXPECT_EQ(of([](int i) { return i + 1; }), 0) << "does no harm";
}

TEST_F(PlacesApart, TellsADriveThatBeganElsewhere) {
  EXPECT_NEAR(of([](int i) { return i + 20; }), 20, 1);
}

// Frame i shows place 2i/3. Place p is in frame 3p/2, p/2 apart, and those beyond 66 are nearest to the last frame, 99
// - p apart: evenly spread up to 33, median 17.
TEST_F(PlacesApart, TellsAnotherSpeed) {
  EXPECT_NEAR(of([](int i) { return 2 * i / 3; }), 17, 2);
}

// Frame i is at 99 - i: |99 - 2i| has the median 50.
TEST_F(PlacesApart, TellsADriveTheOtherWay) {
  EXPECT_NEAR(of([](int i) { return kPlaces - 1 - i; }), 50, 2);
}

TEST_F(PlacesApart, SaysNothingOfWhatHasNothingInCommon) {
  for (std::uint64_t seed = 2; seed < 12; ++seed)
    EXPECT_EQ(places_apart(street_.leftCols(kPlaces), drive(street(seed), [](int i) { return i; })), 0) << seed;
  EXPECT_EQ(places_apart(street_.leftCols(8), street_.middleCols(20, 8)), 0) << "too few";
  EXPECT_EQ(places_apart(street_, Matrix<float>(kFeatures - 1, kPlaces)), 0) << "of another encoder";
  EXPECT_EQ(places_apart({}, street_.leftCols(kPlaces)), 0) << "nobody has the traversal trained on";
}

}  // namespace
}  // namespace citylearn::testing
