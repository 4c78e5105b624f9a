// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/paths.h"

namespace citylearn::testing {

/// Compares text with the file tests/golden/NAME, line by line. CITYLEARN_GOLDEN=write writes the file first.
inline void expect_golden(const std::string& name, const std::string& text) {
  const std::string path = std::string(CITYLEARN_SOURCE_DIR) + "/tests/golden/" + name;
  const char* mode = std::getenv("CITYLEARN_GOLDEN");
  if (mode && std::string(mode) == "write") std::ofstream(path) << text;
  std::ifstream file(path);
  ASSERT_TRUE(file) << path;
  std::istringstream now(text);
  std::string expected, got;
  for (int line = 1; std::getline(file, expected); ++line) {
    ASSERT_TRUE(std::getline(now, got)) << path << ":" << line << ": the text ends early";
    ASSERT_EQ(got, expected) << path << ":" << line;
  }
  EXPECT_FALSE(std::getline(now, got)) << "the text goes on: " << got;
}

}  // namespace citylearn::testing
