// SPDX-License-Identifier: Apache-2.0
#include "core/command_line/help_text.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <regex>
#include <vector>

#include "core/command_line/wrap.h"

namespace citylearn {
namespace {

constexpr std::size_t kColumn = 26;  // where explanations begin

/// The value of an option: how it is written, and what CLI11's checks allow.
struct Value {
  std::string written, allowed;
};

Value value_of(const CLI::Option& option) {
  if (option.get_items_expected_max() == 0) return {};  // a flag
  const std::string type = std::regex_replace(option.get_type_name(), std::regex("^UINT"), "INT");
  std::smatch parts;
  if (std::regex_match(type, parts, std::regex(R"(TEXT:\{(.*)\})"))) {
    std::string names = parts[1];
    if (names.size() > 40) return {"NAME", std::regex_replace(names, std::regex(","), ", ")};
    std::replace(names.begin(), names.end(), ',', '|');
    return {names, ""};
  }
  if (std::regex_match(type, parts, std::regex(R"(ENUM:value in \{(.*?)\}.*)"))) {
    std::string names = std::regex_replace(parts[1].str(), std::regex("->[^,]*"), "");
    std::replace(names.begin(), names.end(), ',', '|');
    return {names, ""};
  }
  if (std::regex_match(type, parts, std::regex(R"((\w+):\w+ in \[(.*) - (.*)\])")))
    return {parts[1], parts[2].str() + ".." + parts[3].str()};
  if (std::regex_match(type, parts, std::regex("(\\w+):(NONNEGATIVE|POSITIVE)"))) return {parts[1], ""};
  return {type, ""};
}

class HelpText : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
    all_ = mode == CLI::AppFormatMode::All;
    std::string text = CLI::Formatter::make_help(app, std::move(name), all_ ? CLI::AppFormatMode::Normal : mode);
    text = std::regex_replace(text, std::regex("\n{3,}"), "\n\n");
    text.erase(text.find_last_not_of('\n') + 2);
    std::string others;
    for (const std::string& group : app->get_groups())
      if (is_plugin_group(group)) others += (others.empty() ? "" : ", ") + group;
    if (!all_ && !others.empty())
      text += "\n" + wrapped("--help-all also explains the parameters of " + others + ".") + "\n";
    return text;
  }
  std::string make_description(const CLI::App* app) const override {
    return wrapped(CLI::Formatter::make_description(app)) + "\n";
  }
  std::string make_group(std::string group, bool positional, std::vector<const CLI::Option*> options) const override {
    if (!all_ && is_plugin_group(group)) return "";
    return CLI::Formatter::make_group(std::move(group), positional, std::move(options));
  }
  std::string make_option(const CLI::Option* option, bool positional) const override {
    const Value value = value_of(*option);
    std::string line = "  " + option->get_name(positional, true);
    if (!positional && !value.written.empty()) line += " " + value.written;
    std::string help = option->get_description();
    if (help.empty() || help.back() != ']') {  // parameters of plug-ins say it themselves
      std::string shown = default_text(*option);
      if (shown.size() > kTerminalWidth - kColumn) shown = std::regex_replace(shown, std::regex(","), ", ");
      if (!shown.empty() || !value.allowed.empty())
        help += " [" + shown + (shown.empty() || value.allowed.empty() ? "" : "; ") + value.allowed + "]";
    }
    if (!option->get_envname().empty()) help += " ($" + option->get_envname() + ")";
    for (const CLI::Option* other : option->get_excludes()) help += " (not with " + other->get_name() + ")";
    std::size_t used = line.size();
    if (used + 2 > kColumn) {
      line += "\n";
      used = 0;
    }
    line.append(kColumn - used, ' ');
    return line + wrapped(help, kColumn) + "\n";
  }

 private:
  mutable bool all_ = false;  // CLI11 does not hand on to groups what is asked for
};

}  // namespace

bool is_plugin_group(const std::string& group) { return !group.empty() && std::islower(group.front()) != 0; }

std::string default_text(const CLI::Option& option) {
  return std::regex_replace(option.get_default_str(), std::regex("[\\[\\]\"]"), "");
}

void add_help(CLI::App& app) {
  app.formatter(std::make_shared<HelpText>());
  const std::vector<std::string> groups = app.get_groups();
  if (std::any_of(groups.begin(), groups.end(), is_plugin_group))
    app.set_help_all_flag("--help-all", "Explain the parameters of plug-ins too, and exit")->group("Options");
}

}  // namespace citylearn
