// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <string>

#include "core/dds/middleware.h"
#include "tests/fuzz/targets.h"

namespace citylearn::fuzz {

/// One type of message: what it begins with, and what must hold whatever the bytes are.
struct MessageTarget {
  /// Valid messages by name, in either byte order and all sizes but the largest.
  std::map<std::string, Bytes> seeds;
  /// Tells whether the bytes were taken.
  std::function<bool(Input)> run;
};

/// Every type of the wire, by its topic without "citylearn/", and every kind of object, as "object_Image".
const std::map<std::string, MessageTarget>& message_targets();

}  // namespace citylearn::fuzz
