// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace citylearn {

/// Returns how many processors this process may use, at least 1: those of its affinity (as taskset, Slurm or a
/// container sets it), or fewer where a control group limits its processor time. A limit of 1.5 processors counts as 2.
/// Tests give another `root` of /proc and /sys.
int available_processors(const std::string& root = "");

}  // namespace citylearn
