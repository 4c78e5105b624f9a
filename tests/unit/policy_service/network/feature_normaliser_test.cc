// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/feature_normaliser.h"

#include <gtest/gtest.h>

#include "policy_service/network/belief/place_keys.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/network_policy.h"
#include "tests/support/networks/some_agent.h"

namespace citylearn::testing {
namespace {

constexpr int kFeatures = 16, kPlaces = 40, kAgents = 4, kSteps = 200;

TEST(FeatureNormaliser, BeforeAnythingWasSeenItKnowsTheTrainingRoute) {
  const Matrix<float> reference = some_task(kFeatures, kPlaces).reference;
  Matrix<float> expected = reference.colwise() - reference.rowwise().mean();
  expected.colwise().normalize();
  EXPECT_TRUE(normalised_reference(reference, kPlaces).isApprox(expected, 1e-5f));
  const FeatureNormaliser normaliser(reference);
  Matrix<float> mean = reference.rowwise().mean();
  normaliser.apply(mean);
  EXPECT_LT(mean.norm(), 1.01f) << "finite, though the mean has no direction";
  SeenFeatures seen;
  seen.see(reference.col(0));
  Matrix<float> same = reference;
  FeatureNormaliser().apply(same, seen);
  EXPECT_EQ(same, reference);
}

/// A condition that moves all features alike: frames look like their places again once enough was seen of it.
TEST(FeatureNormaliser, FollowsACondition) {
  const Matrix<float> reference = some_task(kFeatures, kPlaces).reference,
                      keys = normalised_reference(reference, kPlaces);
  const Matrix<float> winter = reference.colwise() + 2 * Vector<float>::Unit(kFeatures, 3);
  const FeatureNormaliser normaliser(reference);
  SeenFeatures seen;
  const auto likeness = [&] {
    Matrix<float> frames = winter;
    normaliser.apply(frames, seen);
    return (frames.array() * keys.array()).sum() / kPlaces;
  };
  EXPECT_LT(likeness(), 0.6);
  for (int round = 0; round < 20; ++round)
    for (int place = 0; place < kPlaces; ++place) seen.see(winter.col(place));
  EXPECT_GT(likeness(), 0.99);
}

/// Two experiences: a frame looks like its place in the one that resembles it, whatever moved all of the other.
TEST(PlaceKeys, TellAPlaceByAnyOfItsExperiences) {
  const Matrix<float> summer = some_task(kFeatures, kPlaces).reference;
  Matrix<float> snow = summer.rowwise().reverse();  // the same frames elsewhere, and all of them moved
  snow.colwise() += 2 * Vector<float>::Unit(kFeatures, 3);
  Matrix<float> both(kFeatures, 2 * kPlaces);
  both << summer, snow;
  const Matrix<float> normalised = normalised_reference(both, kPlaces);
  EXPECT_EQ(normalised.leftCols(kPlaces), normalised_reference(summer, kPlaces)) << "each by its own mean";
  EXPECT_TRUE(normalised.rightCols(kPlaces).isApprox(normalised_reference(snow, kPlaces)));
  Matrix<float> each, similarity;
  PlaceKeys<float>(both, kFeatures, kPlaces).compare(normalised, kPlaces, each, similarity);
  ASSERT_EQ(similarity.rows(), kPlaces);
  ASSERT_EQ(similarity.cols(), 2 * kPlaces);
  for (int place = 0; place < kPlaces; ++place) {
    EXPECT_NEAR(similarity(place, place), 1, 1e-5);
    EXPECT_NEAR(similarity(kPlaces - 1 - place, place), 1, 1e-5) << "as the other experience shows it";
    EXPECT_NEAR(similarity(place, kPlaces + place), 1, 1e-5);
  }
  PlaceKeys<float>(both, kFeatures, kPlaces).compare(normalised, 5, each, similarity);
  EXPECT_EQ(similarity.rows(), 5) << "of a lesson";
  for (const std::ptrdiff_t places : {0, kPlaces - 1, 2 * kPlaces - 1})
    EXPECT_THROW(PlaceKeys<float>(both.leftCols(places), kFeatures, kPlaces), Error) << places;
}

/// Returns what agents see at a step: at random, of one route, from `seed` on another one.
msg::Observation some_observation(const Matrix<float>& features, Random& random, int step) {
  msg::Observation o;
  o.feature_dimension() = kFeatures;
  for (std::uint32_t agent = 0; agent < kAgents; ++agent) {
    const auto place = static_cast<std::uint32_t>(1 + random.below(kPlaces - 2));
    o.frame().push_back(place);
    o.position().push_back(place);
    o.goal().push_back(static_cast<std::uint32_t>(random.below(kPlaces)));
    o.flags().push_back(step == 0 ? msg::FLAG_FIRST : 0);
    o.previous_action().push_back(step == 0 ? std::uint8_t{kNoAction} : std::uint8_t{kNext});
    o.allowed().push_back(0b111);
    const auto seen = features.col(place);
    o.features().insert(o.features().end(), seen.begin(), seen.end());
  }
  return o;
}

/// Frames of two experiences of a place are not taken for one another in a minibatch.
TEST(ReadObservation, TellsExperiencesApart) {
  const Matrix<float> summer = some_task(kFeatures, kPlaces).reference, winter = -summer;
  NetworkInputs<float> batch, seen;
  batch.resize(kFeatures, 2, kAgents);
  for (const int experience : {0, 1}) {
    Random random{3};
    const msg::Observation o = some_observation(experience == 0 ? summer : winter, random, 0);
    read_observation(o, {.features = kFeatures, .reference = {}}, 0, kPlaces, false, seen, {}, experience);
    for (int agent = 0; agent < kAgents; ++agent) batch.copy_column(seen, agent, experience * kAgents + agent);
  }
  for (int agent = 0; agent < kAgents; ++agent)
    EXPECT_EQ(batch.features_of(agent), -batch.features_of(kAgents + agent)) << agent;
}

/// Two walks that see the same at first act alike until the difference: nothing was known of what came after it.
TEST(FeatureNormaliser, NothingLaterChangesAnAction) {
  const NetworkTask task = some_task(kFeatures, kPlaces);
  ControlTask known{0, kPlaces, task.reference};
  const auto make = [&](const std::string& name) -> std::unique_ptr<Policy> {
    if (name.ends_with("_filter") && name != "place_filter") {
      const auto& entry = ControlRegistry::instance().find("control", name);
      return entry.create(Parameters(name, entry.parameters, {}), known);
    }
    // The walk never comes to the end of the route: it is possible only to a filter that gives up all places alike.
    const std::map<std::string, double> exact = {{"slip", 0}};
    TrainedAgent agent = some_agent(name, task, name == "place_filter" ? exact : std::map<std::string, double>());
    agent.first_frame = 0;
    return std::make_unique<NetworkPolicy>(agent, NetworkPolicy::Options());
  };
  for (const std::string name : {"place_filter", "features", "sequence_filter"}) {
    const auto one = make(name), other = make(name);
    Random random{3}, same{3};
    bool differed = false;
    for (int step = 0; step < kSteps; ++step) {
      const bool early = step < kSteps / 2;
      msg::Observation seen = some_observation(task.reference, random, step);
      msg::Observation changed = some_observation(task.reference, same, step);
      if (!early)
        for (float& value : changed.features()) value = -value + 0.3f;
      std::vector<std::uint8_t> choice, another;
      one->act(seen, choice);
      other->act(changed, another);
      if (early)
        EXPECT_EQ(choice, another) << name << ", step " << step;
      else
        differed = differed || choice != another;
    }
    EXPECT_TRUE(differed) << name << " looks at what it is shown";
  }
}

}  // namespace
}  // namespace citylearn::testing
