// SPDX-License-Identifier: Apache-2.0
// A learner that a test sees through, built as a plug-in (tests/unit/core/plugin/plugins_test.cc): every update adds
// `rate` to every parameter.
#include "policy_service/learning/learner.h"

#ifndef SAMPLE_NAME
#define SAMPLE_NAME "sample"
#endif

namespace citylearn {
namespace {

class Sample : public Learner {
 public:
  Sample(const Parameters& parameters, const LearnerTask& task) : rate_(static_cast<float>(parameters["rate"])) {
    Random random{task.seed};
    task.network.initialise(random, parameters_);
  }
  UpdateFigures update(std::span<Rollout* const> rollouts) override {
    for (Rollout* rollout : rollouts) rollout->estimate_advantages(0.9, 0.9);
    parameters_.array() += rate_;
    return {};
  }
  const Vector<float>& parameters() const override { return parameters_; }
  void save(LearnerState& state) const override { state.tensors["parameters"] = parameters_; }
  void load(const LearnerState& state) override {
    if (!state.tensors.contains("parameters")) throw Error("has no parameters", "learner " SAMPLE_NAME);
    parameters_ = state.tensors.at("parameters");
  }

 private:
  float rate_;
  Vector<float> parameters_;
};

const LearnerRegistry::Registration sample_registration{
    {SAMPLE_NAME,
     "adds a number, for tests",
     {{"rate", "what is added", 0.5, 0, 1}},
     [](const Parameters& parameters, const LearnerTask& task) -> std::unique_ptr<Learner> {
       return std::make_unique<Sample>(parameters, task);
     }}};

}  // namespace
}  // namespace citylearn
