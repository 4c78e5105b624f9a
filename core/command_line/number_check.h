// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace citylearn {

/// Lets all numbers of a command line refuse NaN, which CLI::Range lets pass, and what CLI11 makes other numbers of:
/// nothing, more than 64 bits and, where they count, a minus and a leading 0. Call it when all options are there.
void check_numbers(CLI::App& app);

}  // namespace citylearn
