// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "core/exchange/presence.h"
#include "idl/common.h"

namespace citylearn {

/// Tells which messages of one type from one process were overtaken on the way, by their numbers. The newest number
/// counts for kSilence: no message is under way for so long, and a forged high number must not shut out all later ones.
class MessageOrder {
 public:
  /// Returns false if a message with a higher number came less than kSilence ago. Repetitions are in order.
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
