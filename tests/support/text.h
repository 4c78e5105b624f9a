// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <string>

namespace citylearn::testing {

/// Whether `part` stands somewhere in `text`; a failure shows the text.
inline ::testing::AssertionResult contains(const std::string& text, const std::string& part) {
  const bool found = text.find(part) != text.npos;
  return (found ? ::testing::AssertionSuccess() : ::testing::AssertionFailure())
         << (found ? "'" : "no '") << part << "' in '" << text << "'";
}

}  // namespace citylearn::testing
