// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stdexcept>
#include <string>

#include "core/util/text.h"

namespace citylearn {

/// The one exception of this project. Its message is a single line for a person: what is wrong, where, and what to do.
/// Thrown anywhere, caught in `main` alone (and at the wire, where a bad message is counted and dropped).
class Error : public std::runtime_error {
 public:
  /// `where` names the file, line, field, topic or option; `remedy` says what to do. Either may be empty.
  explicit Error(const std::string& what, const std::string& where = "", const std::string& remedy = "")
      : std::runtime_error(
            one_line((where.empty() ? "" : where + ": ") + what + (remedy.empty() ? "" : " (" + remedy + ")"))) {}
};

}  // namespace citylearn
