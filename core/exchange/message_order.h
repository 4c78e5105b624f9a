// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "core/exchange/presence.h"
#include "idl/common.h"

namespace citylearn {

/// Tells which messages of one type from one process were overtaken on the way, by their numbers. A number counts for
/// kSilence after it came: no message is under way for so long, and a forged number must not silence its namesake.
class MessageOrder {
 public:
  /// Returns false for a message that is older than another one that came lately. One that comes twice is in order.
  bool in_order(const msg::Header& header, Clock::time_point now) {
    if (header.message() < newest_ && came_.here(now)) return false;
    newest_ = header.message();
    came_.heard(now);
    return true;
  }

 private:
  std::uint64_t newest_ = 0;
  Presence came_;
};

}  // namespace citylearn
