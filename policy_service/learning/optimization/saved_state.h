// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <initializer_list>
#include <string>

#include "core/util/error.h"
#include "policy_service/learning/learner.h"

namespace citylearn {

/// Throws Error naming the first counter or tensor that a saved state lacks, or the first tensor that does not have
/// `size` finite numbers. `who` names the learner.
inline void require_state(const LearnerState& state, const std::string& who,
                          std::initializer_list<const char*> counters, std::initializer_list<const char*> tensors,
                          std::ptrdiff_t size) {
  for (const char* name : counters)
    if (!state.counters.contains(name)) throw Error("has no counter '" + std::string(name) + "'", who);
  for (const char* name : tensors) {
    const std::string which = "tensor '" + std::string(name) + "'";
    const auto found = state.tensors.find(name);
    if (found == state.tensors.end()) throw Error("has no " + which, who);
    if (found->second.size() != size)
      throw Error(which + " has " + std::to_string(found->second.size()) + " numbers, not " + std::to_string(size),
                  who);
    if (!found->second.allFinite()) throw Error(which + " has numbers that are not finite", who);
  }
}

}  // namespace citylearn
