// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/task_waves.h"

#include <algorithm>

namespace citylearn {

void TaskWaves::next(const std::map<std::uint32_t, SeenFeatures>& seen) {
  for (const auto& [task, features] : seen) known_.add(features);
  wave_.first += wave_.count;
  const std::uint32_t left = tasks_ - wave_.first;
  wave_.count = seen.empty() ? left : std::min(wave_.first, left);
}

}  // namespace citylearn
