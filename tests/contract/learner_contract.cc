// What every learner promises (policy_service/learner.h), asked of all that are registered in this program.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "core/error.h"
#include "policy_service/learner.h"

namespace citylearn {
namespace {

constexpr int kPlaces = 12, kFeatures = 6;

/// What some agents might have seen and done: walks on a route, episodes that end both ways. No two `number`s alike.
Rollout walk(const AgentNetwork<float>& network, std::uint64_t number, int steps, int agents, int sequence) {
  Rollout rollout;
  rollout.resize(kFeatures, static_cast<int>(network.state_size()), steps, agents, sequence);
  Random random{number, 77};
  Matrix<float> places(kFeatures, kPlaces);
  for (float& value : places.reshaped()) value = static_cast<float>(random.normal());
  rollout.states.setZero();
  rollout.max_steps = 2 * kPlaces;
  rollout.inputs.frames = rollout.next.frames = kPlaces;
  for (int agent = 0; agent < agents; ++agent) {
    int place = static_cast<int>(random.below(kPlaces)), goal = 0;
    std::uint8_t previous = 255;
    for (int t = 0; t <= steps; ++t) {
      NetworkInputs<float>& inputs = t < steps ? rollout.inputs : rollout.next;
      const std::ptrdiff_t column = t < steps ? t * agents + agent : agent;
      const auto k = static_cast<std::size_t>(column);
      if (previous == 255) goal = (place + 1 + static_cast<int>(random.below(kPlaces - 1))) % kPlaces;
      inputs.see(column, place, places.col(place));
      inputs.shown[k] = inputs.position[k] = place;
      inputs.goal[k] = goal;
      inputs.previous_action[k] = previous;
      inputs.first[k] = previous == 255;
      inputs.allowed[k] = static_cast<std::uint8_t>(1 | (place < kPlaces - 1) << 1 | (place > 0) << 2);
      if (t == steps) break;
      std::uint8_t action = 0;
      do action = static_cast<std::uint8_t>(random.below(3));
      while (!(inputs.allowed[k] >> action & 1));
      place += action == 1 ? 1 : action == 2 ? -1 : 0;
      const bool reached = place == goal, late = !reached && random.below(20) == 0;
      rollout.action[k] = action;
      rollout.log_probability[k] = static_cast<float>(-1 - random.uniform());
      rollout.value[k] = static_cast<float>(random.uniform());
      rollout.reward[k] = reached ? 1.0f : -1.0f / kPlaces;
      rollout.ended[k] = reached ? Rollout::kTerminated : late ? Rollout::kTruncated : Rollout::kGoesOn;
      rollout.final_value[k] = late ? 0.5f : 0.0f;
      previous = reached || late ? std::uint8_t{255} : action;
    }
    rollout.last_value[static_cast<std::size_t>(agent)] = 0.25f;
  }
  return rollout;
}

std::vector<std::string> learners() {
  std::vector<std::string> names;
  for (const auto* entry : LearnerRegistry::instance().entries()) names.push_back(entry->name);
  return names;
}

class LearnerContract : public testing::TestWithParam<std::string> {
 protected:
  LearnerContract() {
    const auto& entry = NetworkRegistry<float>::instance().find("network", "features");
    network_parameters_ = Parameters("network", entry.parameters, {{"hidden", 16}, {"cells", 8}});
    task_.features = kFeatures;
    task_.frames = kPlaces;
    network_ = entry.create(network_parameters_, task_);
  }
  std::unique_ptr<Learner> make(std::uint64_t seed, const std::map<std::string, double>& given = {}) const {
    const auto& entry = LearnerRegistry::instance().find("learner", GetParam());
    return entry.create(Parameters("learner", entry.parameters, given),
                        LearnerTask{*network_, "features", network_parameters_, task_, seed, 10000});
  }
  /// `updates` updates from two environments with different numbers of agents.
  void learn(Learner& learner, std::uint64_t first, std::uint64_t updates) const {
    for (std::uint64_t i = first; i < first + updates; ++i) {
      Rollout one = walk(*network_, 2 * i, 16, 4, 8), other = walk(*network_, 2 * i + 1, 16, 1, 8);
      Rollout* both[] = {&one, &other};
      const UpdateFigures figures = learner.update(both);
      for (const double figure : {figures.policy_loss, figures.value_loss, figures.entropy, figures.gradient_norm})
        ASSERT_TRUE(std::isfinite(figure)) << "update " << i;
      ASSERT_TRUE(learner.parameters().allFinite()) << "update " << i;
    }
  }

  NetworkTask task_;
  Parameters network_parameters_;
  std::unique_ptr<AgentNetwork<float>> network_;
};
INSTANTIATE_TEST_SUITE_P(, LearnerContract, testing::ValuesIn(learners()),
                         [](const auto& tested) { return tested.param; });

TEST_P(LearnerContract, SameSeedSameBitsOtherSeedOthers) {
  const auto one = make(1), again = make(1), other = make(2);
  ASSERT_EQ(one->parameters().size(), network_->parameter_count());
  const Vector<float> start = one->parameters();
  for (const auto& learner : {one.get(), again.get(), other.get()}) learn(*learner, 0, 5);
  EXPECT_EQ(one->parameters(), again->parameters());
  EXPECT_NE(one->parameters(), other->parameters());
  EXPECT_NE(one->parameters(), start) << "it learned nothing";
}

TEST_P(LearnerContract, GoesOnFromWhatItSavedBitForBit) {
  const auto straight = make(1), resumed = make(1);
  learn(*straight, 0, 3);
  LearnerState state;
  straight->save(state);
  ASSERT_TRUE(state.tensors.contains("parameters"));
  EXPECT_EQ(state.tensors["parameters"], straight->parameters());
  resumed->load(state);
  learn(*straight, 3, 3);
  learn(*resumed, 3, 3);
  EXPECT_EQ(straight->parameters(), resumed->parameters());
}

TEST_P(LearnerContract, RefusesWhatIsNotItsOwnAndIsAsBefore) {
  const auto learner = make(1), untouched = make(1);
  learn(*learner, 0, 2);
  learn(*untouched, 0, 2);
  LearnerState state;
  learner->save(state);
  EXPECT_THROW(learner->load({}), Error);
  for (const auto& [name, tensor] : state.tensors) {
    LearnerState damaged = state;
    damaged.tensors[name] = Vector<float>::Zero(tensor.size() + 1);
    EXPECT_THROW(learner->load(damaged), Error) << name << " of another size";
    damaged.tensors.erase(name);
    EXPECT_THROW(learner->load(damaged), Error) << "without " << name;
  }
  for (const auto& [name, count] : state.counters) {
    LearnerState damaged = state;
    damaged.counters.erase(name);
    EXPECT_THROW(learner->load(damaged), Error) << "without " << name;
  }
  learn(*learner, 2, 2);
  learn(*untouched, 2, 2);
  EXPECT_EQ(learner->parameters(), untouched->parameters());
}

TEST_P(LearnerContract, ParametersHaveDefaultsWithinTheirRanges) {
  for (const ParameterSpec& spec : LearnerRegistry::instance().find("learner", GetParam()).parameters) {
    EXPECT_FALSE(spec.help.empty()) << spec.name;
    EXPECT_NO_THROW(make(1, {{spec.name, spec.standard}})) << spec.name;
    EXPECT_THROW(make(1, {{spec.name, spec.maximum + std::max(1.0, spec.maximum)}}), Error) << spec.name;
  }
  EXPECT_THROW(make(1, {{"no-such-parameter", 1}}), Error);
}

}  // namespace
}  // namespace citylearn
