// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tools/paper/work.h"
#include "tools/paper/world.h"

// What is measured without a policy.

namespace citylearn::paper {

/// An answer of place recognition is right when it is at most so many frames off.
inline constexpr int kPlaceTolerance = 2;

/// Adds the unit that recognises all frames of `query` among those of the traversal learned from. Outcome: {"queries",
/// "auc", "auc_low", "auc_high", "recall"}; the interval comes from resampled blocks of neighbouring frames. Returns
/// {"representation", "method", "query", "unit"}.
Json add_recognition(const std::string& representation, const std::string& method, const std::string& query, Work& work,
                     World& world);

/// Returns the unit that measures resident memory on the traversal learned from: what one more Environment of 16 agents
/// adds to a process that already has the recording (mean of many, each with the observation that it sends); and the
/// whole memory of an env_service that hosts one, before a policy drives it. Outcome: {"environments", "agents",
/// "bytes": {"environment", "process"}}, process null unless an env_service was built beside this program.
Unit memory_unit(const std::string& representation, World& world);

}  // namespace citylearn::paper
