// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "core/util/error.h"
#include "policy_service/learning/trainer.h"

namespace citylearn::bench {

/// Assigns each name=value to the part that has such a parameter: network, learner or trainer. Throws Error.
inline void give_parameters(const std::vector<std::string>& set, TrainerOptions& options) {
  const auto known = Trainer::recommended_parameters(options.agent, options.learner);
  for (const std::string& one : set) {
    const std::size_t equals = one.find('=');
    if (equals == std::string::npos) throw Error("is not name=value", "--set " + one);
    const std::string name = one.substr(0, equals);
    const double value = std::stod(one.substr(equals + 1));
    if (known.at("network").contains(name))
      options.network_parameters[name] = value;
    else if (known.at("learner").contains(name))
      options.learner_parameters[name] = value;
    else if (known.at("trainer").contains(name))
      options.trainer_parameters[name] = value;
    else
      throw Error("no such parameter", "--set " + one);
  }
}

}  // namespace citylearn::bench
