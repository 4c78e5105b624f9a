// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace CLI {
class App;
}

namespace citylearn {

/// Adds --config: a TOML file with the options of `app`, their names without dashes. In quotes a # is part of the
/// value; elsewhere it begins a comment. (CLI11 2.1 cuts quoted values at it.)
void add_settings_file(CLI::App& app, const std::string& help = "");

}  // namespace citylearn
