// SPDX-License-Identifier: Apache-2.0
// Writes where the fuzzing of messages begins: FOLDER/message_TYPE/NAME. Made anew each time, as a new protocol refuses
// what an older one wrote.
#include <filesystem>
#include <fstream>
#include <iostream>

#include "tests/fuzz/messages.h"

int main(int count, char** arguments) {
  if (count != 2) {
    std::cerr << "usage: fuzz_message_seeds FOLDER\n";
    return 2;
  }
  for (const auto& [type, target] : citylearn::fuzz::message_targets()) {
    const std::filesystem::path folder = std::filesystem::path(arguments[1]) / ("message_" + type);
    std::filesystem::create_directories(folder);
    for (const auto& [name, bytes] : target.seeds) {
      std::ofstream file(folder / name, std::ios::binary);
      file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
      if (!file.flush()) {
        std::cerr << "cannot write " << folder / name << "\n";
        return 1;
      }
    }
  }
}
