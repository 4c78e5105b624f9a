// SPDX-License-Identifier: Apache-2.0
#pragma once

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

}  // namespace citylearn
