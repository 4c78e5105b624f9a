// SPDX-License-Identifier: Apache-2.0
// The generated city against figures measured on real features: NetVLAD, 64-d, 1,000 frames of Nordland, summer and
// fall.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "tests/paths.h"
#include "tests/support/env/env.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

std::unique_ptr<Dataset> features(std::map<std::string, double> parameters = {}) {
  parameters["images"] = 0;
  return make_dataset("synthetic", "", parameters);
}

double distance(const Traversal& a, int i, const Traversal& b, int j) {
  double sum = 0;
  for (int k = 0; k < a.dimension; ++k) sum += std::pow(a.feature(i)[k] - b.feature(j)[k], 2);
  return std::sqrt(sum);
}

double mean_distance(const Traversal& a, const Traversal& b, int lag) {
  double sum = 0;
  for (int i = 0; i + lag < a.frames; ++i) sum += distance(a, i, b, i + lag);
  return sum / (a.frames - lag);
}

TEST(Synthetic, IsTheSameToTheLastBitEverywhere) {
  const auto dataset = features();
  EXPECT_EQ(dataset->names(), (std::vector<std::string>{"summer", "fall", "winter", "night"}));
  EXPECT_EQ(dataset->load("summer").hash(), 0xF166F6D3941B27D5ull);
  EXPECT_EQ(dataset->load("fall").hash(), 0x3ECF020AF96C77F8ull);
  EXPECT_EQ(dataset->load("winter").hash(), 0x195F78DEAC3EE3B1ull);
  EXPECT_EQ(dataset->load("night").hash(), 0xA94CEC1B602955CFull);
}

TEST(Synthetic, OtherSeedsAndConditionsAreOtherCities) {
  std::set<std::uint64_t> hashes;
  for (const int seed : {0, 1, 2, 1000000000})
    for (const std::string& name : features()->names()) hashes.insert(features({{"seed", seed}})->load(name).hash());
  EXPECT_EQ(hashes.size(), 16u);
}

TEST(Synthetic, AShorterRouteIsTheBeginningOfALongerOne) {
  const Traversal brief = features({{"frames", 10}})->load("fall");
  const Traversal whole = features()->load("fall");
  EXPECT_TRUE(std::equal(brief.features.begin(), brief.features.end(), whole.features.begin()));
}

TEST(Synthetic, AnyDimensionIsOfUnitLengthAndFinite) {
  for (const int dimension : {8, 9, 64, 100, 512, 4096}) {
    const Traversal traversal = features({{"dimension", dimension}, {"frames", 20}})->load("night");
    EXPECT_EQ(traversal.dimension, dimension);
    ASSERT_EQ(traversal.features.size(), 20u * dimension);
    for (int frame = 0; frame < 20; ++frame) {
      double sum = 0;
      for (const float value : traversal.feature(frame)) sum += value * value;
      EXPECT_NEAR(sum, 1, 1e-4);
    }
  }
}

TEST(Synthetic, RefusesParametersOutOfRange) {
  EXPECT_THROW(features({{"frames", 1}}), Error);
  EXPECT_THROW(features({{"dimension", 4097}}), Error);
  EXPECT_THROW(features({{"colour", 1}}), Error);
  EXPECT_THROW(features()->load("spring"), Error);
}

TEST(Synthetic, PositionsAreAboutTenMetresApartAndTheSameUnderEveryCondition) {
  const auto dataset = features();
  const Traversal summer = dataset->load("summer");
  ASSERT_EQ(summer.positions.size(), 1000u);
  EXPECT_EQ(summer.positions[0], 0);
  for (int i = 1; i < 1000; ++i) {
    EXPECT_GT(summer.positions[i] - summer.positions[i - 1], 4);
    EXPECT_LT(summer.positions[i] - summer.positions[i - 1], 16);
  }
  EXPECT_NEAR(summer.positions[999], 9990, 500);
  EXPECT_EQ(dataset->load("night").positions, summer.positions);
}

TEST(Synthetic, DistancesAreThoseOfRealFeatures) {
  const auto dataset = features();
  const Traversal summer = dataset->load("summer"), fall = dataset->load("fall");
  // Measured on the recordings: .625, .687, .754, .804, .830, .855 in summer; .518 between the seasons at one place.
  EXPECT_NEAR(mean_distance(summer, summer, 1), 0.625, 0.05);
  EXPECT_NEAR(mean_distance(summer, summer, 2), 0.687, 0.05);
  EXPECT_NEAR(mean_distance(summer, summer, 5), 0.754, 0.05);
  EXPECT_NEAR(mean_distance(summer, summer, 10), 0.804, 0.05);
  EXPECT_NEAR(mean_distance(summer, summer, 20), 0.830, 0.05);
  EXPECT_NEAR(mean_distance(summer, summer, 40), 0.855, 0.05);
  EXPECT_NEAR(mean_distance(fall, fall, 1), 0.595, 0.05);
  EXPECT_NEAR(mean_distance(summer, fall, 0), 0.518, 0.05);
  double pairs = 0, squares = 0, mean = 0;
  int count = 0;
  for (int i = 0; i < 1000; ++i)
    for (int j = 0; j < i; ++j) {
      const double d = distance(summer, i, summer, j);
      pairs += d;
      squares += d * d;
      ++count;
    }
  pairs /= count;
  EXPECT_NEAR(pairs, 0.871, 0.05);
  EXPECT_NEAR(std::sqrt(squares / count - pairs * pairs), 0.143, 0.03);
  for (int k = 0; k < 64; ++k) {
    double sum = 0;
    for (int i = 0; i < 1000; ++i) sum += summer.feature(i)[k] / 1000;
    mean += sum * sum;
  }
  EXPECT_NEAR(std::sqrt(mean), 0.782, 0.05) << "length of the mean vector";
}

TEST(Synthetic, StreetsAreAGridSeenAhead) {
  for (const double images : {0, 1}) {
    const auto city = make_dataset("synthetic", "", {{"images", images}}),
               route = make_dataset("synthetic", "", {{"images", images}, {"frames", 896}});
    city->walk_by(StateRule::kStreet);
    const Traversal streets = city->load("fall"), line = route->load("fall");
    const auto map = streets.states();
    ASSERT_EQ(map->states(), 896);
    EXPECT_EQ(map->places(), 64 + 112 * 3) << "crossings, and blocks with places between";
    // The drive begins along the first street to the north: 28 links, and then to the south.
    for (int state = 0, frame = 0; frame < 28; ++frame, state = map->next(state, kForward)) {
      EXPECT_EQ(map->heading(state), 0);
      // Turns come round after two links, and on the edge of the city after three at a crossing.
      EXPECT_EQ(map->after(state, kRight, frame > 0 && frame % 4 == 0 ? 3 : 2), state) << frame;
      if (images > 0)
        EXPECT_EQ(streets.images->fingerprint(state), line.images->fingerprint(frame));
      else
        EXPECT_EQ(streets.feature(state)[7], line.feature(frame)[7]);
    }
    const std::vector<std::uint16_t> steps = map->steps_to({0});
    EXPECT_EQ(std::count(steps.begin(), steps.end(), StateMap::kNoWay), 0);
    city->walk_by(StateRule::kStreetFixed);
    EXPECT_TRUE(holds(error_of([&] { city->load("fall"); }), "--rule: the drawn city is seen along its links"));
  }
}

TEST(Synthetic, HarderAndHarderToRecognise) {
  const auto dataset = features();
  const Traversal summer = dataset->load("summer");
  double last = 0;
  for (const std::string& name : dataset->names()) {
    const double now = mean_distance(dataset->load(name), summer, 0);
    EXPECT_GE(now, last) << name;
    last = now;
  }
}

}  // namespace
}  // namespace citylearn::testing
