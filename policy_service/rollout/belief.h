// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/task/state_map.h"
#include "idl/forward.h"
#include "policy_service/network/network_inputs.h"

namespace citylearn {

/// Adds what an agent believes to a message. The softmax of `scores` (N, one per place of the route from `first_frame`
/// on) is its belief p: probabilities of standing at each place. Entropy is -sum p log2 p. The probability of being
/// lost is 1 - (p(b - 1) + p(b) + p(b + 1)) with b the likeliest place, of equals the first. On streets places are
/// states, and beside b count those to which an action leads from it, or from which one leads to it.
void add_belief(const Eigen::Ref<const Vector<float>>& scores, int first_frame, msg::Belief& belief,
                const StateMap* streets = nullptr);

}  // namespace citylearn
