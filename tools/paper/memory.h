// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// The env_service that was built beside this program; empty where there is none.
std::string env_service_program();

/// Measures resident memory on the traversal learned from: what one more Environment of 16 agents adds to a process
/// that has the recording already (mean of many, each with the observation that it sends), and with `program` what an
/// env_service takes that hosts such a one, whole, before a policy drives it.
/// Outcome: {"environments", "agents", "bytes": {"environment", "process"}}, process null without `program`.
Unit memory_unit(const std::string& representation, const std::string& program, World& world);

}  // namespace citylearn::paper
