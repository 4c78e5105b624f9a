// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>

#include "core/exchange/timing.h"

namespace citylearn {

/// The ways in which env_services send what their agents see. Policies receive the same numbers either way.
enum class Observing {
  kAsFits,       ///< by reference where an encoder_service made the features, so that observations need not pass by
                 ///< it, and where an observation with its features exceeds kMaxWholeBytes
  kWhole,        ///< with features
  kByReference,  ///< frames by name; their features are fetched once, before
};

struct EnvClientOptions {
  Observing observing = Observing::kAsFits;
  /// Hears the env_services of attach() alone, instead of all.
  bool attached_only = false;
  /// Time for a running service to deliver features or confirm settings, after which its env_service is refused.
  std::chrono::milliseconds patience = kCommandGiveUp;
};

}  // namespace citylearn
