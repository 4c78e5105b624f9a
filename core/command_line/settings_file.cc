// SPDX-License-Identifier: Apache-2.0
#include "core/command_line/settings_file.h"

#include <CLI/CLI.hpp>
#include <memory>
#include <set>
#include <sstream>

#include "core/util/text.h"

namespace citylearn {
namespace {

/// Takes comments away before CLI11 reads the lines, and refuses what CLI11 would pass over. Errors name the file.
class SettingsFile : public CLI::ConfigTOML {
 public:
  explicit SettingsFile(CLI::App& app) : app_(app) {
    comment('\n');  // which is in no line: what is left of # is part of a value
  }

  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override {
    std::string line, text;
    while (std::getline(input, line)) {
      if (text.empty()) line = without_byte_order_mark(line);
      char quote = 0;
      std::size_t end = 0;
      for (; end < line.size() && (quote != 0 || line[end] != '#'); ++end) {
        if (quote == '"' && line[end] == '\\' && end + 1 < line.size())
          ++end;
        else if (quote == 0 && (line[end] == '"' || line[end] == '\''))
          quote = line[end];
        else if (line[end] == quote)
          quote = 0;
      }
      text += line.substr(0, end) + "\n";
    }
    std::istringstream without_comments(text);
    std::vector<CLI::ConfigItem> found = CLI::ConfigTOML::from_config(without_comments);
    std::set<std::string> names;
    for (const CLI::ConfigItem& item : found) try {
        if (!item.parents.empty()) refuse("has a section [" + item.parents[0] + "]: write its options without one");
        if (!names.insert(item.name).second) refuse(item.name + " stands there twice");
        apply(item);
      } catch (const CLI::ParseError& error) {
        throw CLI::ConfigError(app_.get_config_ptr()->as<std::string>() + ": " + error.what(), error.get_exit_code());
      }
    return found;
  }

 private:
  [[noreturn]] static void refuse(const std::string& what) {
    throw CLI::ConfigError(what, CLI::ExitCodes::ConfigError);
  }

  /// Gives an option its value, as CLI11 does with what from_config() returns, which then finds it there already.
  void apply(const CLI::ConfigItem& item) const {
    CLI::Option* option = app_.get_option_no_throw("--" + item.name);
    if (!option && app_.get_allow_config_extras() != CLI::config_extras_mode::error) return;
    if (!option) refuse("unknown option '" + item.name + "'");
    if (!option->get_configurable()) refuse(item.name + " is for the command line alone");
    if (item.inputs.empty()) refuse(item.name + " has no value");
    if (item.inputs.size() > 1 && option->get_items_expected_max() <= 1)
      refuse(item.name + " has " + std::to_string(item.inputs.size()) + " values: give one, in quotes if it is a text");
    if (!option->empty()) return;
    const bool flag = option->get_expected_min() == 0;
    option->add_result(flag ? std::vector{option->get_flag_value(item.name, item.inputs[0])} : item.inputs);
    option->run_callback();
  }

  CLI::App& app_;
};

}  // namespace

void add_settings_file(CLI::App& app, const std::string& help) {
  app.config_formatter(std::make_shared<SettingsFile>(app));
  app.set_config("--config", "", help);
}

}  // namespace citylearn
