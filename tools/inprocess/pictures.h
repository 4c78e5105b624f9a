// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>

#include "env_service/dataset_io/traversal.h"

namespace citylearn {

/// Turns the pictures of routes into features, as an encoder_service would.
class Pictures {
 public:
  /// Frames `first` .. `first` + `frames` - 1 are the route. The encoder learns from those of `reference`, if it is one
  /// that learns. Throws Error: unknown encoder, pictures that are missing or too few.
  Pictures(const std::string& encoder, const Traversal& reference, int first, int frames);
  ~Pictures();
  /// The traversal with features in the place of its pictures; it ends with the route, and before the route they are
  /// zeros.
  Traversal encode(const Traversal& traversal);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace citylearn
