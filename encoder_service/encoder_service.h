// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <string>

#include "core/wire/node_options.h"
#include "encoder_service/encoding/encoder.h"
#include "encoder_service/encoding/reduction.h"

namespace citylearn {

struct EncoderServiceOptions {
  NodeOptions node;

  // From pictures to descriptors.
  std::string encoder = kDefaultEncoder;
  std::map<std::string, double> parameters;  ///< those given
  EncoderFiles files;

  // From descriptors to features.
  std::string reference = "summer";  ///< traversal that the encoder and the reduction learn from
  ReductionOptions reduction;
  bool cap_dimension = false;  ///< fewer features where the reference is too short for as many, as for a default
  std::string reduction_file;  ///< a reduction learned before, instead of one learned on `reference`; empty: none

  // Storage, and broken pictures.
  std::string store;  ///< folder of descriptors and of what was learned; empty: nothing is stored
  /// A broken picture gets its nearest neighbour's features; otherwise its traversal is refused.
  bool skip_bad_frames = false;
};

/// Encodes the frames of every traversal with images that the env_services of the session announce, each once, and
/// completes their TraversalInfo and Observations with features, until `stop` returns true (asked at least every 50 ms;
/// pictures being encoded are finished and stored). Any number of encoder_services of the session with the same options
/// share the work, with or without a common store (docs/decisions/0006-encoding.md). Throws Error when another encoder
/// serves the session or the middleware fails.
void run_encoder_service(const EncoderServiceOptions& options, const std::function<bool()>& stop);

}  // namespace citylearn
