// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace citylearn {

/// Creates the store `path` unless it is there. One of an earlier schema is kept beside it (`path`.schema-8) and a new
/// one begins. Throws Error, the file then untouched, when it is not a store of ours, damaged, or of a newer schema.
void prepare_file(const std::string& path);

}  // namespace citylearn
