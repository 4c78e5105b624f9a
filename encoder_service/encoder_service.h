// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "encoder_service/pipeline/encoder_service_options.h"

namespace citylearn {

/// Encodes the frames of every traversal with images that the env_services of the session announce, each once, and
/// completes their TraversalInfo and Observations with features, until `stop` returns true (asked at least every 50 ms;
/// pictures being encoded are finished and stored). Any number of encoder_services of the session with the same options
/// share the work, with or without a common store (docs/decisions/0006-encoding.md). Throws Error when another encoder
/// serves the session or the middleware fails.
void run_encoder_service(const EncoderServiceOptions& options, const std::function<bool()>& stop);

}  // namespace citylearn
