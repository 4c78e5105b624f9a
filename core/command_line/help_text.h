// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace citylearn {

/// Gives a program its `--help`: 80 columns, after each option its default and what is allowed, "[2; 1..1000]".
/// Parameters of plug-ins, whose groups have names in lower case, are left to `--help-all`, which programs with such
/// parameters get too. Call it when all options are there.
void add_help(CLI::App& app);

/// Returns whether a group of options has the parameters of a plug-in.
bool is_plugin_group(const std::string& group);

/// Returns an option's default as one would write it, "lo" and not "[lo]"; empty if it has none.
std::string default_text(const CLI::Option& option);

}  // namespace citylearn
