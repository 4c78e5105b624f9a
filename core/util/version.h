// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace citylearn {

/// Returns the version of the programs, with the git revision they were built from: "0.1.0 (abc1234)".
std::string version();

}  // namespace citylearn
