// SPDX-License-Identifier: Apache-2.0
// The services' own code in simulation (docs/explanation/simulation.md).
#include <gtest/gtest.h>

#include <cstdio>
#include <set>
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

TEST(Simulation, ALearnerAndActorsWithoutFaultsKeepAllInvariants) {
  const Output output = simulate("--seed 1 --layout actors --without-faults");
  EXPECT_EQ(output.status, 0) << output.text;
}

TEST(Simulation, TheSameSeedIsTheSameToTheLastByteAndOthersAreNot) {
  std::set<std::string> traces;
  for (const std::string layout : {"lockstep", "actors", "encoder", "replay"}) {
    const std::string arguments = "--seed 3 --layout " + layout;
    const Output one = simulate(arguments), other = simulate(arguments);
    ASSERT_FALSE(trace_of(one.text).empty()) << one.text;
    EXPECT_EQ(trace_of(one.text), trace_of(other.text)) << one.text << other.text;
    traces.insert(trace_of(one.text));
  }
  traces.insert(trace_of(simulate("--seed 4 --layout actors").text));
  EXPECT_EQ(traces.size(), 5u);
}

TEST(Simulation, KeepsAllInvariantsWhateverGoesWrong) {
  const Output output = simulate("--seeds 1..200");
  EXPECT_EQ(output.status, 0) << output.text;
}

/// The messages that an env_service and an actor get do not depend on how many others there are.
TEST(Simulation, AMessageReachesAsManyServicesHoweverManyHostsThereAre) {
  for (const int hosts : {1, 4}) {
    const Output output = simulate("--hosts " + std::to_string(hosts) + " 2>/dev/null");
    ASSERT_EQ(output.status, 0) << output.text;
    const std::string envs = std::to_string(10 * hosts);
    EXPECT_NE(output.text.find(envs + " env_services of 16 agents (" + envs + " at work)"), std::string::npos)
        << output.text;
    const auto expect_copies = [&](const std::string& message, const std::string& copies) {
      const std::size_t row = output.text.find("\n| " + message + " |");
      ASSERT_NE(row, std::string::npos) << output.text;
      EXPECT_NE(output.text.substr(row, output.text.find('\n', row + 1) - row).find("| " + copies + " |"),
                std::string::npos)
          << message << "\n"
          << output.text;
    };
    for (const char* message : {"action", "observation", "episode_acknowledgement", "training_acknowledgement",
                                "trajectory", "trajectory_acknowledgement"})
      expect_copies(message, "1.0");
    expect_copies("episode_stat", "3.0");
    expect_copies("training_stat", "2.0");
    expect_copies("parameters_chunk", std::to_string(hosts) + ".0");
    const std::string joins = ", observation ";
    const std::size_t at = output.text.rfind(joins);
    ASSERT_NE(at, std::string::npos) << output.text;
    EXPECT_LT(std::stod(output.text.substr(at + joins.size())), 100) << output.text;
  }
}

TEST(LongSimulation, KeepsAllInvariantsWhateverGoesWrong) {
  const Output output = simulate("--seeds 1..1000");
  EXPECT_EQ(output.status, 0) << output.text;
}

}  // namespace
}  // namespace citylearn::testing
