// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/belief.h"

#include <gtest/gtest.h>

#include <limits>

#include "idl/action.h"
#include "policy_service/rollout/network_policy.h"
#include "tests/support/env/env.h"
#include "tests/support/networks/small_networks.h"

namespace citylearn::testing {
namespace {

msg::Belief belief_of(const std::vector<double>& probabilities, int first_frame) {
  Vector<float> scores(probabilities.size());
  for (std::size_t i = 0; i < probabilities.size(); ++i)
    scores(static_cast<std::ptrdiff_t>(i)) = static_cast<float>(std::log(probabilities[i]));
  msg::Belief belief;
  add_belief(scores.cwiseMax(-1e5f), first_frame, belief);
  return belief;
}

TEST(Belief, HasTheLikeliestPlacesEntropyAndTheProbabilityOfBeingLost) {
  const msg::Belief belief = belief_of({1 / 16., 1 / 16., 0, 1 / 2., 1 / 4., 0, 0, 1 / 8., 0, 0}, 17);
  EXPECT_EQ(belief.likely(), (std::vector<std::uint32_t>{20, 21, 24, 17, 18, 19, 22, 23})) << "equals in their order";
  const std::vector<float> expected = {1 / 2.f, 1 / 4.f, 1 / 8.f, 1 / 16.f, 1 / 16.f, 0, 0, 0};
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(belief.probability()[i], expected[i], 1e-6);
  EXPECT_NEAR(belief.entropy()[0], 1 / 2. + 2 / 4. + 3 / 8. + 2 * 4 / 16., 1e-5);
  EXPECT_NEAR(belief.lost()[0], 1 - (1 / 2. + 1 / 4.), 1e-6) << "place 2, before the likeliest one, has nothing";
}

TEST(Belief, IsWholeOnRoutesOfAnyLengthAndAtTheirEnds) {
  const msg::Belief belief = belief_of({3 / 4., 0, 1 / 4.}, 0);
  EXPECT_EQ(belief.likely(), (std::vector<std::uint32_t>{0, 2, 1, 0, 0, 0, 0, 0}));
  EXPECT_NEAR(belief.probability()[0] + belief.probability()[1], 1, 1e-6);
  EXPECT_EQ(belief.probability()[7], 0);
  EXPECT_NEAR(belief.lost()[0], 1 / 4., 1e-6);
  const msg::Belief sure = belief_of({0, 0, 1}, 0);
  EXPECT_EQ(sure.entropy()[0], 0);
  EXPECT_EQ(sure.lost()[0], 0);
}

TEST(Belief, OfParametersThatAreNotFiniteIsNone) {
  msg::Belief belief;
  add_belief(Vector<float>::Constant(4, std::numeric_limits<float>::quiet_NaN()), 0, belief);
  EXPECT_NEAR(belief.entropy()[0], 2, 1e-6) << "four places alike";
}

/// On frames that look nothing like one another, one look tells the place.
TEST(Belief, IsThatOfTheAgentsThatActed) {
  const Traversal city = small_city();
  Loop loop(city, small_options("place_filter"), 1, 3);
  NetworkPolicy policy(loop.trainer.agent(), {.seed = 5});
  Environment environment(city, 3);
  environment.reset(settings(msg::TRAIN, 16, 16));
  msg::Observation seen;
  msg::Belief belief;
  policy.believe(belief);
  EXPECT_TRUE(belief.lost().empty()) << "none has acted";
  std::vector<std::uint8_t> choice;
  environment.observe(seen);
  policy.act(seen, choice);
  policy.believe(belief);
  ASSERT_EQ(belief.lost().size(), 3u);
  for (std::size_t agent = 0; agent < 3; ++agent) EXPECT_EQ(belief.likely()[8 * agent], seen.position()[agent]);
  msg::Belief none;
  NetworkPolicy other(Loop(city, small_options("features"), 1, 3).trainer.agent(), {.seed = 5});
  other.act(seen, choice);
  other.believe(none);
  EXPECT_TRUE(none.likely().empty());
}

}  // namespace
}  // namespace citylearn::testing
