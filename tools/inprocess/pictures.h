// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>

#include "env_service/dataset_io/traversal.h"

namespace citylearn {

/// Encodes the pictures of routes as features, as an encoder_service would.
class Pictures {
 public:
  /// Frames `first` .. `first` + `frames` - 1 are the route. An encoder that learns does so from those of `reference`.
  /// Throws Error when the encoder is unknown, or pictures are missing or too few.
  Pictures(const std::string& encoder, const Traversal& reference, int first, int frames);
  ~Pictures();
  /// Returns the traversal with features in place of its pictures; it ends with the route, and features before the
  /// route are zeros.
  Traversal encode(const Traversal& traversal);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace citylearn
