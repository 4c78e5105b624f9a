// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <set>
#include <string>

#include "policy_service/learning/learner.h"
#include "policy_service/learning/trainer.h"

namespace citylearn {

/// The plug-ins that a trainer uses, and all parameters in effect: those given, over what the network recommends, over
/// defaults. Throws Error naming an unknown plug-in or parameter.
struct TrainerParameters {
  TrainerParameters() = default;
  explicit TrainerParameters(const TrainerOptions& options, bool streets = false);
  /// Returns them by "network", "learner" and "trainer".
  std::map<std::string, std::map<std::string, double>> values() const;

  const NetworkRegistry<float>::Entry* network_entry = nullptr;
  const LearnerRegistry::Entry* learner_entry = nullptr;
  Parameters network, learner, trainer;
  std::set<std::string> recommended;  ///< names of those of learner and trainer that the network recommends
};

/// Returns `specs`, the parameters of the learner `learner` or of the trainer (""), with `recommended` set where any
/// network recommends a value.
std::vector<ParameterSpec> mark_recommended(std::vector<ParameterSpec> specs, const std::string& learner);

}  // namespace citylearn
