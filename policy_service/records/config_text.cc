// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/config_text.h"

#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <cstdlib>

#include "core/wire/help_text.h"

namespace citylearn {
namespace {

/// Returns where a value that was given comes from.
std::string origin_of(const CLI::App& app, const CLI::Option& option, const std::vector<std::string>& arguments) {
  const std::string name = option.get_name();
  for (const std::string& word : arguments)
    if (word == name || word.starts_with(name + "=")) return "command line";
  const std::string& variable = option.get_envname();
  if (const char* value = variable.empty() ? nullptr : std::getenv(variable.c_str()); value && *value)
    return "environment, " + variable;
  const CLI::Option* config = app.get_config_ptr();
  return config && !config->empty() ? "file " + config->as<std::string>() : "command line";
}

/// What the line of an option says.
struct Line {
  std::string value, origin;
};

Line line_of(const CLI::App& app, const CLI::Option& option, const std::vector<std::string>& arguments) {
  if (!option.empty()) return {CLI::detail::join(option.results(), ","), origin_of(app, option, arguments)};
  if (option.get_items_expected_max() == 0) return {"no", "default"};  // a flag
  const std::string value = default_text(option);
  return {value.empty() ? "-" : value, "default"};
}

}  // namespace

std::string config_text(const CLI::App& app, const std::vector<std::string>& arguments, const PluginValues& effective,
                        const PluginValues& defaults, const std::string& agent) {
  const auto recommended = [&](const std::string& plugin, const std::string& name) -> Line {
    const double value = effective.at(plugin).at(name);
    return {fmt::format("{}", value), value == defaults.at(plugin).at(name) ? "default" : "recommended by " + agent};
  };
  std::string text;
  for (const CLI::Option* option : app.get_options()) {
    const std::string name = option->get_name(), group = option->get_group();
    if (!option->nonpositional() || option->get_lnames().empty()) continue;
    const std::string& word = option->get_lnames().front();
    if (word == "help" || word == "help-all" || word == "version" || word == "list" || word == "show-config" ||
        word == "recommended-agents")
      continue;
    Line line = line_of(app, *option, arguments);
    if (effective.contains(group)) {
      if (option->empty()) line = recommended(group, word.substr(group.size() + 1));
    } else if (is_plugin_group(group)) {
      continue;  // of a plug-in that takes no part
    } else if (word == "steps" && option->empty()) {
      line = recommended("trainer", "steps");
    }
    text += fmt::format("{:<28} {:<24} {}\n", name, line.value, line.origin);
  }
  return text;
}

}  // namespace citylearn
