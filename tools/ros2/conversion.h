// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/ros2/translation.h"

namespace citylearn {

struct Ros2Conversion {
  std::vector<std::string> files;  ///< recordings (citylearn record), or the parts of one, in their order
  std::string session;             ///< messages of other sessions are left out; empty: none are
  int widest = 640;                ///< of pictures, pixels
  Ros2Translation::Options translation;
};

struct Ros2ConversionResult {
  std::uint64_t pictures = 0;          ///< sent
  std::uint64_t missing_pictures = 0;  ///< the recording has none of what an agent saw
  std::uint64_t unreadable = 0;        ///< messages that cannot be decoded: of another version, perhaps
};

/// Translates recordings. Reads them twice: first their maps and pictures, which it keeps in memory, because a recorder
/// gets them after the observations that they belong to. Throws Error naming the file and the byte where one is
/// damaged.
Ros2ConversionResult convert(const Ros2Conversion& conversion, Ros2Sink& sink);

}  // namespace citylearn
