// SPDX-License-Identifier: Apache-2.0
// The lossy decorator loses, repeats and reorders as much as it says, and the same again for the same seed.
#include <gtest/gtest.h>

#include <cstring>
#include <set>

#include "core/dds/middleware.h"
#include "tests/support/options.h"

namespace citylearn {
namespace {

constexpr std::uint32_t kDomain = 105;
constexpr std::uint32_t kSamples = 4000;

std::vector<std::uint32_t> through(const std::string& name) {
  const auto middleware = create_middleware(testing::middleware_options(name, kDomain));
  const Topic topic{"test/lossy", "citylearn::test::Bytes", Profile::kCommand, 8};
  const auto publisher = middleware->create_publisher(topic);
  const auto subscription = middleware->create_subscription(topic);
  std::vector<std::uint32_t> received;
  Bytes sample(8);
  const auto take_all = [&] {
    Bytes taken;
    while (subscription->take(taken)) {
      std::uint32_t number;
      std::memcpy(&number, taken.data() + 4, sizeof number);
      received.push_back(number);
    }
  };
  for (std::uint32_t number = 0; number < kSamples; ++number) {
    std::memcpy(sample.data() + 4, &number, sizeof number);
    publisher->publish(sample);
    take_all();
  }
  middleware->wait(Clock::now());  // lets a sample go that was held back
  take_all();
  return received;
}

int count_backward(const std::vector<std::uint32_t>& numbers) {
  int backward = 0;
  for (std::size_t i = 1; i < numbers.size(); ++i) backward += numbers[i] < numbers[i - 1];
  return backward;
}

std::set<std::uint32_t> different(const std::vector<std::uint32_t>& numbers) {
  return {numbers.begin(), numbers.end()};
}

TEST(Lossy, WithoutLossItIsTransparent) {
  const auto received = through("lossy,drop=0,repeat=0,reorder=0:inprocess");
  ASSERT_EQ(received.size(), kSamples);
  EXPECT_EQ(count_backward(received), 0);
}

TEST(Lossy, DropsItsShare) {
  const auto received = through("lossy,drop=0.25,repeat=0,reorder=0:inprocess");
  EXPECT_NEAR(static_cast<double>(received.size()) / kSamples, 0.75, 0.03);  // over 4 standard deviations
  EXPECT_EQ(count_backward(received), 0);
}

TEST(Lossy, RepeatsItsShare) {
  const auto received = through("lossy,drop=0,repeat=0.25,reorder=0:inprocess");
  EXPECT_EQ(different(received).size(), kSamples);
  EXPECT_NEAR(static_cast<double>(received.size()) / kSamples, 1.25, 0.03);
}

TEST(Lossy, ReordersItsShareAndLosesNothing) {
  const auto received = through("lossy,drop=0,repeat=0,reorder=0.2:inprocess");
  EXPECT_EQ(received.size(), kSamples);
  EXPECT_EQ(different(received).size(), kSamples);
  // One held back cannot be followed by another one: 0.2 / 1.2 of them overtake.
  EXPECT_NEAR(static_cast<double>(count_backward(received)) / kSamples, 0.2 / 1.2, 0.03);
}

TEST(Lossy, DefaultsDoAllThree) {
  const auto received = through("lossy:inprocess");
  EXPECT_NEAR(static_cast<double>(different(received).size()) / kSamples, 0.9, 0.02);
  EXPECT_GT(received.size(), different(received).size());
  EXPECT_GT(count_backward(received), 100);
}

TEST(Lossy, TheSeedDecides) {
  EXPECT_EQ(through("lossy,seed=5:inprocess"), through("lossy,seed=5:inprocess"));
  EXPECT_EQ(through("lossy:inprocess"), through("lossy,drop=0.1,repeat=0.1,reorder=0.1,seed=1:inprocess"));
  EXPECT_NE(through("lossy,seed=5:inprocess"), through("lossy,seed=6:inprocess"));
}

TEST(Lossy, StacksOnItself) {
  const auto received = through("lossy,drop=0.5,repeat=0,reorder=0:lossy,drop=0.5,repeat=0,reorder=0,seed=2:inprocess");
  EXPECT_NEAR(static_cast<double>(received.size()) / kSamples, 0.25, 0.03);
}

}  // namespace
}  // namespace citylearn
