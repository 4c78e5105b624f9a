// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// Returns the path of the env_service that was built beside this program; empty where there is none.
std::string env_service_program();

/// Measures resident memory on the traversal learned from: what one more Environment of 16 agents adds to a process
/// that already has the recording (mean of many, each with the observation that it sends); and, with `program`, the
/// whole memory of an env_service that hosts one, before a policy drives it.
/// Outcome: {"environments", "agents", "bytes": {"environment", "process"}}, process null without `program`.
Unit memory_unit(const std::string& representation, const std::string& program, World& world);

}  // namespace citylearn::paper
