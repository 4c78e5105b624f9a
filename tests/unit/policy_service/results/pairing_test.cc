// SPDX-License-Identifier: Apache-2.0
#include "policy_service/results/pairing.h"

#include <gtest/gtest.h>

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
Matrix<float> drive(const Matrix<float>& street, const std::function<int(int)>& where, float noise = 0.7F) {
  Random random{7};
  Matrix<float> frames(kFeatures, kPlaces);
  for (int i = 0; i < kPlaces; ++i)
    for (int k = 0; k < kFeatures; ++k)
      frames(k, i) = 3 + street(k, where(i)) + noise * static_cast<float>(random.normal());
  return frames;
}

class Pairs : public ::testing::Test {
 protected:
  int of(const std::function<int(int)>& where, float noise = 0.7F) const {
    const Pairing pairing = examine_pairs(street_.leftCols(kPlaces), drive(street_, where, noise));
    EXPECT_FALSE(pairing.unlike);
    return pairing.apart;
  }
  const Matrix<float> street_ = street(1);
};

TEST_F(Pairs, AreNotBlamedWhereTheyAreRight) {
  EXPECT_EQ(of([](int i) { return i; }), 0);
  EXPECT_EQ(of([](int i) { return i + 1; }), 0) << "does no harm";
}

TEST_F(Pairs, TellADriveThatBeganElsewhere) {
  EXPECT_NEAR(of([](int i) { return i + 20; }), 20, 1);
}

// Frame i shows place 2i/3. Place p is in frame 3p/2, p/2 apart, and those beyond 66 are nearest to the last frame, 99
// - p apart: evenly spread up to 33, median 17.
TEST_F(Pairs, TellAnotherSpeed) {
  EXPECT_NEAR(of([](int i) { return 2 * i / 3; }), 17, 2);
}

// Frame i is at 99 - i: |99 - 2i| has the median 50.
TEST_F(Pairs, TellADriveTheOtherWay) {
  EXPECT_NEAR(of([](int i) { return kPlaces - 1 - i; }), 50, 2);
}

// Frames that share little with the street: a path gains no more by them than the other way does, a line does.
TEST_F(Pairs, AreToldByLinesWhereAPathIsLostInNoise) {
  EXPECT_NEAR(of([](int i) { return kPlaces - 1 - i; }, 3), 50, 2);
  EXPECT_NEAR(of([](int i) { return i + 20; }, 3), 20, 1);
  EXPECT_EQ(of([](int i) { return i; }, 3), 0);
}

TEST_F(Pairs, TellAnotherStreet) {
  for (std::uint64_t seed = 2; seed < 12; ++seed)
    EXPECT_EQ(examine_pairs(street_.leftCols(kPlaces), drive(street(seed), [](int i) { return i; })),
              (Pairing{.apart = 0, .unlike = true}))
        << seed;
}

TEST_F(Pairs, SayNothingOfTooLittle) {
  EXPECT_EQ(examine_pairs(street_.leftCols(8), street_.middleCols(20, 8)), Pairing()) << "too few";
  EXPECT_EQ(examine_pairs(street_, Matrix<float>(kFeatures - 1, kPlaces)), Pairing()) << "of another encoder";
  EXPECT_EQ(examine_pairs({}, street_.leftCols(kPlaces)), Pairing()) << "nobody has the traversal trained on";
  EXPECT_EQ(examine_pairs(street_, Matrix<float>::Zero(kFeatures, kPlaces)), Pairing()) << "without features";
}

}  // namespace
}  // namespace citylearn::testing
