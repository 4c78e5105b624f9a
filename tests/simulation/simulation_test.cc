// SPDX-License-Identifier: Apache-2.0
// The services' own code in simulation (docs/explanation/simulation.md).
#include <gtest/gtest.h>

#include <cstdio>
#include <string>

#include "tests/paths.h"

namespace citylearn::testing {
namespace {

struct Output {
  int status = -1;
  std::string text;
};

/// Runs the program, whose memory lies elsewhere each time.
Output simulate(const std::string& arguments) {
  Output output;
  FILE* pipe = ::popen((std::string(CITYLEARN_SIMULATE) + " " + arguments).c_str(), "r");
  char part[4096];
  while (std::fgets(part, sizeof part, pipe)) output.text += part;
  output.status = ::pclose(pipe);
  return output;
}

std::string trace_of(const std::string& text) {
  const std::size_t begin = text.find("trace ");
  return begin == text.npos ? "" : text.substr(begin, 22);
}

TEST(Simulation, ATrainingWithoutFaultsKeepsAllInvariants) {
  const Output output = simulate("--seed 1 --without-faults");
  EXPECT_EQ(output.status, 0) << output.text;
}

TEST(Simulation, TheSameSeedIsTheSameToTheLastByte) {
  for (const char* seed : {"3", "4"}) {
    const Output one = simulate("--seed " + std::string(seed)), other = simulate("--seed " + std::string(seed));
    ASSERT_FALSE(trace_of(one.text).empty()) << one.text;
    EXPECT_EQ(trace_of(one.text), trace_of(other.text)) << one.text << other.text;
  }
}

TEST(Simulation, OtherSeedsAreOtherSimulations) {
  EXPECT_NE(trace_of(simulate("--seed 3").text), trace_of(simulate("--seed 4").text));
}

TEST(Simulation, KeepsAllInvariantsWhateverGoesWrong) {
  const Output output = simulate("--seeds 1..20");
  EXPECT_EQ(output.status, 0) << output.text;
}

TEST(LongSimulation, KeepsAllInvariantsWhateverGoesWrong) {
  const Output output = simulate("--seeds 1..1000");
  EXPECT_EQ(output.status, 0) << output.text;
}

}  // namespace
}  // namespace citylearn::testing
