// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>

#include "encoder_service/encoding/encoder.h"
#include "env_service/dataset_io/traversal.h"

namespace citylearn::vpr {

/// Ctrl-C arrived: what is complete is kept, the rest is left.
struct Stopped {};

/// D x F descriptors of a traversal, and how long they took.
struct Descriptors {
  Eigen::MatrixXf matrix;
  double seconds = 0;
  int encoded = 0;  ///< frames; the others came from the store
};

/// The encoder learns from the reference's pictures, when it is one that learns. Throws Error, Stopped.
void teach(Encoder& encoder, const Traversal& reference);

/// Encodes a traversal of pictures in order. With a `store` folder, frames that are there are read and new ones
/// written. Throws Error, Stopped.
Descriptors encode(Encoder& encoder, const Traversal& traversal, const std::string& label, const std::string& store);

/// Features that a traversal has already.
Descriptors features_of(const Traversal& traversal);

}  // namespace citylearn::vpr
