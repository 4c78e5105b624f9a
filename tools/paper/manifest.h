// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ctime>
#include <string>

#include "tools/paper/section.h"

namespace citylearn::paper {

/// Text of manifest.json: what one needs to know to make the report again, and what was written (SHA-256 of `report`'s
/// files). `begun` and `seconds` are of the run that wrote it, "work" holds what each unit took whenever it was done.
std::string manifest_of(const Context& context, const Report& report, std::time_t begun, double seconds);

}  // namespace citylearn::paper
