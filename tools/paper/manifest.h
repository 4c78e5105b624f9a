// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ctime>
#include <string>

#include "tools/paper/context.h"

namespace citylearn::paper {

/// Returns the text of manifest.json: what one needs to know to make the report again. `begun` and `seconds` are of the
/// run that wrote it; "work" holds what each unit took whenever it was done. The program that makes the page adds
/// "files", the SHA-256 of all files of the report.
std::string manifest_of(const Context& context, const std::string& command, std::time_t begun, double seconds);

}  // namespace citylearn::paper
