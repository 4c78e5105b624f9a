// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <sstream>
#include <string>
#include <vector>

#include "core/util/error.h"

namespace citylearn::testing {

/// Returns whether `part` stands somewhere in `text`; a failure shows the text.
inline ::testing::AssertionResult contains(const std::string& text, const std::string& part) {
  const bool found = text.find(part) != text.npos;
  return (found ? ::testing::AssertionSuccess() : ::testing::AssertionFailure())
         << (found ? "'" : "no '") << part << "' in '" << text << "'";
}

/// Returns whether `text` is one line that contains `part`.
inline ::testing::AssertionResult holds(const std::string& text, const std::string& part) {
  if (text.find('\n') != text.npos) return ::testing::AssertionFailure() << "more than a line: " << text;
  return contains(text, part);
}

/// Returns how often `part` stands in `text`.
inline int occurrences(const std::string& text, const std::string& part) {
  int count = 0;
  for (std::size_t at = text.find(part); at != text.npos; at = text.find(part, at + part.size())) ++count;
  return count;
}

/// Returns the number in front of `word` where it stands last in `text`; -1 where it does not.
inline int number_before(const std::string& text, const std::string& word) {
  const std::size_t at = text.rfind(word);
  if (at == std::string::npos) return -1;
  const std::size_t from = text.find_last_not_of("0123456789", at - 1) + 1;
  return std::atoi(text.substr(from, at - from).c_str());
}

/// The parts of a text between separators, the last line end aside.
inline std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, separator);) parts.push_back(part);
  return parts;
}
inline std::vector<std::string> lines_of(const std::string& text) { return split(text, '\n'); }

/// The line of the Error that `call` throws; empty when it throws none.
template <class Call>
std::string error_of(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace citylearn::testing
