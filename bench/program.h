// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "tests/support/processes/service.h"

namespace citylearn::bench {

/// Returns the command line of a service in a session of its own.
inline std::vector<std::string> on_wire(std::vector<std::string> command, const std::string& middleware, int domain,
                                        const std::string& session = "") {
  command.insert(command.end(), {"--middleware", middleware, "--domain", std::to_string(domain), "--session",
                                 "bench-" + std::to_string(getpid()) + session});
  return command;
}

/// Waits until the program has ended and returns its output. Throws Error unless its exit status is 0.
inline std::string finish(testing::Service& program, const std::string& what,
                          std::chrono::minutes patience = std::chrono::minutes(20)) {
  if (program.wait(patience) != 0) throw Error(what + " failed:\n" + program.output());
  return program.output();
}

/// Returns the steps per second from the first row of a metrics.csv to the last: without the time in which processes
/// find each other. Throws Error unless it has two rows.
inline double training_rate(const std::string& path) {
  std::ifstream in(path);
  double steps[2] = {}, wall[2] = {};
  std::string line;
  for (int row = -1; std::getline(in, line); ++row) {
    double update, episodes, lesson;
    if (row < 0 ||
        std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf,%lf", &update, &steps[1], &episodes, &lesson, &wall[1]) != 5)
      continue;
    if (row == 0) steps[0] = steps[1], wall[0] = wall[1];
  }
  if (wall[1] <= wall[0]) throw Error("has fewer than two updates", path, "train for more steps");
  return (steps[1] - steps[0]) / (wall[1] - wall[0]);
}

}  // namespace citylearn::bench
