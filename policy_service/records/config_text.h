// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace citylearn {

/// Values by parameter, by plug-in: "ppo" -> "learning-rate" -> 0.006.
using PluginValues = std::map<std::string, std::map<std::string, double>>;

/// Returns what --show-config prints: a line for each option with the value that will count and where it comes from:
/// the command line, the environment, a file (--config), what the agent recommends, or the default. `arguments` are the
/// words of the command line, `effective` the values of the plug-ins that take part where nothing is given, `defaults`
/// those without a recommendation. Parameters of other plug-ins are left out.
std::string config_text(const CLI::App& app, const std::vector<std::string>& arguments, const PluginValues& effective,
                        const PluginValues& defaults, const std::string& agent);

}  // namespace citylearn
