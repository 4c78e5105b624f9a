// SPDX-License-Identifier: Apache-2.0
#include "core/util/error.h"

#include <gtest/gtest.h>

#include <string>

namespace citylearn {
namespace {

TEST(Error, SaysWhatWhereAndWhatToDo) {
  EXPECT_STREQ(Error("is empty").what(), "is empty");
  EXPECT_STREQ(Error("is empty", "a.csv").what(), "a.csv: is empty");
  EXPECT_STREQ(Error("is empty", "a.csv:3", "fill it").what(), "a.csv:3: is empty (fill it)");
}

TEST(Error, IsOneLineWhateverItQuotes) {
  const std::string name("two\nlines\r\tand\0more\x1B[31m\x7F", 24);
  EXPECT_STREQ(Error("unknown '" + name + "'", "f\n", "r\n").what(), "f : unknown 'two lines  and?more?[31m' (r )");
  EXPECT_STREQ(Error("Grüße").what(), "Grüße");  // letters beyond ASCII stay
}

}  // namespace
}  // namespace citylearn
