// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tests/support/processes/service.h"

namespace citylearn::bench {

/// Returns the command line of a service in a session of this process.
inline testing::Arguments on_wire(testing::Arguments command, const std::string& middleware, int domain,
                                  const std::string& session = "bench-" + std::to_string(getpid())) {
  command.insert(command.end(), {"--middleware", middleware, "--domain", std::to_string(domain), "--session", session});
  return command;
}

/// Waits until the program has ended and returns its output. Throws Error unless its exit status is 0.
inline std::string finish(testing::Service& program, const std::string& what) {
  if (program.wait(std::chrono::minutes(20)) != 0) throw Error(what + " failed:\n" + program.output());
  return program.output();
}

/// Makes a keystore in a folder that is not there yet, with keys of these services: {kind, id}. Throws Error.
inline void make_keystore(const std::string& keys, const std::vector<std::pair<std::string, std::string>>& services) {
  const auto run = [&](testing::Arguments command) {
    command.insert(command.begin(), CITYLEARN_SOURCE_DIR "/compose/keystore");
    testing::Service program(command, keys + ".log");
    finish(program, "keystore");
  };
  run({"create", keys});
  for (const auto& [kind, id] : services) run({"add", keys, kind, id});
}

}  // namespace citylearn::bench
