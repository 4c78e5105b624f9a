// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace citylearn {

/// Returns the words of a file or pipe, each of which ends with a null byte. Throws Error if it cannot be read.
std::vector<std::string> read_words(const std::string& path);

/// Returns the arguments of the command `demo` whose results are in `folder`, as a manifest.json there has them; that
/// of one of its seeds if it trained several. Throws Error if there is none.
std::vector<std::string> demo_command_of(const std::string& folder);

}  // namespace citylearn
