// SPDX-License-Identifier: Apache-2.0
#include "core/command_line/settings_file.h"

#include <CLI/CLI.hpp>
#include <memory>
#include <sstream>

namespace citylearn {
namespace {

/// Takes comments away before CLI11 reads the lines.
class SettingsFile : public CLI::ConfigTOML {
 public:
  SettingsFile() { comment('\n'); }  // which is in no line: what is left of # is part of a value

  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override {
    std::string line, text;
    while (std::getline(input, line)) {
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
    return CLI::ConfigTOML::from_config(without_comments);
  }
};

}  // namespace

void add_settings_file(CLI::App& app, const std::string& help) {
  app.config_formatter(std::make_shared<SettingsFile>());
  app.set_config("--config", "", help);
}

}  // namespace citylearn
