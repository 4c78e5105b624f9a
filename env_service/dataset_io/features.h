// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "env_service/traversal/traversal.h"

namespace citylearn {

/// Reads a file of features without header: a frame a line, numbers separated by commas. Fills frames, dimension and
/// features. Throws Error naming the line: no number, another number of columns than before, an empty line between
/// frames.
void read_features(const std::string& path, Traversal& traversal);

}  // namespace citylearn
