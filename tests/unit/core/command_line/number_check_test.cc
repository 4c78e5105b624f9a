// SPDX-License-Identifier: Apache-2.0
#include "core/command_line/number_check.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>

#include "core/wire/service.h"

namespace citylearn::testing {
namespace {

/// Returns what a program says of one argument, or of an option and an empty value; empty if it takes it.
std::string said_of(const std::string& argument) {
  CLI::App app;
  double speed = 1, slip = 0, free = 0;
  std::uint64_t steps = 0;
  std::int64_t change = 0;
  unsigned agents = 1;
  std::string name;
  std::map<std::string, double> parameters;
  app.add_option("--speed", speed)->check(CLI::Range(0.0, 10.0));
  app.add_option("--slip", slip)->check(CLI::Range(0.0, 1.0))->type_name("P");
  app.add_option("--free", free);
  app.add_option("--steps", steps);
  app.add_option("--change", change);
  app.add_option("--agents", agents)->check(CLI::Range(1u, 16u));
  app.add_option("--name", name);
  add_parameters(app, "agent", {{"rate", "of learning", 1, 0, 2}}, parameters);
  check_numbers(app);
  try {
    app.parse(argument.ends_with(' ') ? std::vector<std::string>{"", argument.substr(0, argument.size() - 1)}
                                      : std::vector<std::string>{argument});
  } catch (const CLI::ParseError& error) {
    return error.what();
  }
  return "";
}

TEST(NumberCheck, NumbersAreNotNan) {
  EXPECT_EQ(said_of("--speed=nan"), "--speed: nan is not a number");
  EXPECT_EQ(said_of("--slip=-NaN"), "--slip: -NaN is not a number");
  EXPECT_EQ(said_of("--free=nan(1)"), "--free: nan(1) is not a number");
  EXPECT_EQ(said_of("--agent-rate=nan"), "--agent-rate: nan is not a number");
}

/// CLI11 would make 0 of nothing, and the largest number of larger ones.
TEST(NumberCheck, NumbersAreThereAndFit) {
  EXPECT_EQ(said_of("--steps "), "--steps: needs a number");
  EXPECT_EQ(said_of("--free "), "--free: needs a number");
  EXPECT_EQ(said_of("--steps=18446744073709551616"), "--steps: 18446744073709551616 has more than 64 bits");
  EXPECT_EQ(said_of("--change=9223372036854775808"), "--change: 9223372036854775808 has more than 64 bits");
  EXPECT_EQ(said_of("--steps=18446744073709551615") + said_of("--change=-9223372036854775808"), "");
}

TEST(NumberCheck, CountsAreNotNegative) {
  EXPECT_EQ(said_of("--steps=-1"), "--steps: -1 is less than 0");
  EXPECT_NE(said_of("--agents=-1"), "");
}

/// CLI11 would make 8 of 010.
TEST(NumberCheck, CountsAreWrittenAsTheyAreMeant) {
  for (const char* padded : {"010", "08", "+01"})
    EXPECT_EQ(said_of("--steps=" + std::string(padded)),
              "--steps: " + std::string(padded) + " begins with 0, as octal numbers do");
}

TEST(NumberCheck, NumbersAndTextsPass) {
  for (const char* argument : {"--speed=2", "--steps=3", "--steps=0", "--agents=16", "--name=-1", "--slip=0.5",
                               "--free=-1e300", "--agent-rate=0", "--name=nan"})
    EXPECT_EQ(said_of(argument), "") << argument;
}

}  // namespace
}  // namespace citylearn::testing
