// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/task_waves.h"

#include <algorithm>

namespace citylearn {

void TaskWaves::next(const std::map<std::uint32_t, SeenFeatures>& seen) {
  for (const auto& [task, features] : seen) known_.add(features);
  wave_.first += wave_.count;
  wave_.count = std::min(wave_.first, tasks_ - wave_.first);
}

}  // namespace citylearn
