#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace citylearn {

/// An ordered list of frames recorded once along a route under one condition. Frame i of one traversal of a route is
/// the same place as frame i of its siblings.
struct Traversal {
  std::string dataset;           ///< "plain", "synthetic"
  std::string name;              ///< unique within the dataset: "summer"
  std::string condition;         ///< "summer", "night" ...; empty when unknown
  int frames = 0;                ///< F
  int dimension = 0;             ///< D, features a frame
  std::vector<float> features;   ///< F x D, frame-major
  std::vector<float> positions;  ///< F, metres along the route; NaN where unknown

  std::span<const float> feature(int frame) const {
    return {features.data() + static_cast<std::size_t>(frame) * dimension, static_cast<std::size_t>(dimension)};
  }
  /// First 8 bytes of SHA-256 over dataset, F, D, features and positions: other data, other hash. The name is left out.
  std::uint64_t hash() const;
};

}  // namespace citylearn
