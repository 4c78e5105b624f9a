// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tests/support/processes/service.h"

namespace citylearn::bench {

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
