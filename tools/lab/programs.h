// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace citylearn::lab {

/// Runs one of this project's Python programs, named by its path below tools/, with Debian's interpreter, and waits for
/// its end. Throws Error with the last line that it printed when it fails, Stopped when Ctrl-C arrives meanwhile.
void run_python(const std::string& program, const std::vector<std::string>& arguments);

}  // namespace citylearn::lab
