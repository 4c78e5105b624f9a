// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace citylearn {

/// Lets all numbers of a command line refuse NaN, which CLI::Range lets pass, and those that count refuse what CLI11
/// makes other numbers of: a minus and a leading 0. Call it when all options are there.
void check_numbers(CLI::App& app);

}  // namespace citylearn
