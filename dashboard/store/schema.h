// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace citylearn {

/// Step i makes schema i + 1 out of schema i (schema 0: an empty file). Steps that were released never change.
const std::vector<std::string>& schema_steps();

/// Creates the store `path`, or brings it up to the newest schema; of an older one a copy is kept beside it
/// (`path`.schema-1). Throws Error, the file then untouched, when it is not a store of ours, damaged, or of a newer
/// schema than `steps`.
void prepare_file(const std::string& path, const std::vector<std::string>& steps = schema_steps());

}  // namespace citylearn
