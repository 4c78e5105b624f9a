// SPDX-License-Identifier: Apache-2.0
#include "core/command_line/number_check.h"

#include <CLI/CLI.hpp>
#include <cerrno>
#include <cmath>
#include <cstdlib>

namespace citylearn {

void check_numbers(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    const std::string type = option->get_type_name();  // with what its range says
    const bool counts = type.find("UINT") != std::string::npos, whole = type.find("INT") != std::string::npos;
    if (!whole && type.find("FLOAT") == std::string::npos) continue;
    option->check([counts, whole](const std::string& given) {
      if (given.empty()) return std::string("needs a number");
      if (std::isnan(std::strtod(given.c_str(), nullptr))) return given + " is not a number";
      if (counts && given.starts_with('-')) return given + " is less than 0";
      errno = 0;
      if (whole)
        counts ? void(std::strtoull(given.c_str(), nullptr, 0)) : void(std::strtoll(given.c_str(), nullptr, 0));
      if (errno == ERANGE) return given + " has more than 64 bits";
      const std::string digits = given.substr(given.starts_with('+') || given.starts_with('-'));
      const bool octal = whole && digits.size() > 1 && digits[0] == '0' && digits[1] >= '0' && digits[1] <= '9';
      return octal ? given + " begins with 0, as octal numbers do" : std::string();
    });
  }
}

}  // namespace citylearn
