// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <string>

#include "core/wire/node.h"
#include "encoder_service/encoding/encoder.h"
#include "encoder_service/encoding/reduction.h"

namespace citylearn {

struct EncoderServiceOptions {
  Node::Options node;

  // From pictures to descriptors.
  std::string encoder = "hog";
  std::map<std::string, double> parameters;  ///< those given
  EncoderFiles files;

  // From descriptors to features.
  std::string reference = "summer";  ///< traversal that the encoder and the reduction learn from
  ReductionOptions reduction;
  std::string reduction_file;  ///< a reduction learned before, instead of one learned on `reference`; empty: none

  // What is kept, and what is done about broken pictures.
  std::string store;  ///< folder of descriptors and of what was learned; empty: memory alone
  bool skip_bad_frames =
      false;  ///< a broken picture gets its nearest neighbour's features; else its traversal is refused
};

/// Encodes the frames of every traversal with images that the env_services of the run announce, each once, and
/// completes their TraversalInfo and Observations with features, until `stop` says so (asked at least every 50 ms; the
/// pictures at hand are finished and kept). Any number of encoder_services with the same options share the work
/// (docs/decisions/0006-encoding.md). Throws Error: another encoder serves the run, or the middleware fails.
void run_encoder_service(const EncoderServiceOptions& options, const std::function<bool()>& stop);

}  // namespace citylearn
