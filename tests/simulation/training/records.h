// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tests/simulation/training/invariants.h"

namespace citylearn::simulation {

/// Add what files hold to `records.recorded`: each episode, as often as it stands there.
void read_csv(const std::string& path, Records& records);
void read_store(const std::string& path, Records& records);
/// Episodes of all recordings that can be read, which may have one many times. Returns what is wrong with another one;
/// empty: nothing.
std::string read_recordings(Records& records);

}  // namespace citylearn::simulation
