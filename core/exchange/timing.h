// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace citylearn {

// Logs (log_sender.h).
inline constexpr std::chrono::milliseconds kLogResend{200};      ///< until what is not acknowledged is sent again
inline constexpr std::chrono::milliseconds kLogResendMax{2000};  ///< the longest such interval; it doubles each time
inline constexpr std::chrono::milliseconds kLogHurried{50};      ///< likewise for a sender that ends

}  // namespace citylearn
