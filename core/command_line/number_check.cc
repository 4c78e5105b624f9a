// SPDX-License-Identifier: Apache-2.0
#include "core/command_line/number_check.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdlib>

namespace citylearn {

void check_numbers(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    const std::string type = option->get_type_name();  // with what its range says
    if (type.find("FLOAT") != std::string::npos)
      option->check([](const std::string& given) {
        return std::isnan(std::strtod(given.c_str(), nullptr)) ? given + " is not a number" : std::string();
      });
    if (type.find("UINT") != std::string::npos)
      option->check(
          [](const std::string& given) { return given.starts_with('-') ? given + " is less than 0" : std::string(); });
  }
}

}  // namespace citylearn
