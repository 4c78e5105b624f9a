// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/learning/trainer.h"

namespace citylearn {

/// The plug-ins that a trainer uses, and all parameters in effect: those given, over what the network recommends, over
/// defaults. Throws Error naming an unknown plug-in or parameter.
struct TrainerParameters {
  TrainerParameters() = default;
  explicit TrainerParameters(const TrainerOptions& options);
  /// Returns them by "network", "learner" and "trainer".
  std::map<std::string, std::map<std::string, double>> values() const;

  const NetworkRegistry<float>::Entry* network_entry = nullptr;
  const LearnerRegistry::Entry* learner_entry = nullptr;
  Parameters network, learner, trainer;
};

}  // namespace citylearn
