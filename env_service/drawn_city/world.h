// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "env_service/dataset_io/images.h"

// A drive through a generated city and its countryside, drawn frame by frame. The world follows from the seed and the
// place along the route; what a recording makes of it (season, weather, parked cars, lit windows) from its look.

namespace citylearn {

struct DrawnOptions {
  int width = 160, height = 96;  ///< pixels of a picture
  std::uint64_t seed = 1;        ///< another seed, another city
  double countryside = 0.35;     ///< share of the route outside of the city, 0..1
  double viewpoint = 1.5;        ///< metres by which the camera of "shifted" drives further left
};

/// Names of the recordings: "summer", "fall", "winter", "night", "overcast", "rain", "shifted".
const std::vector<std::string>& drawn_names();

/// A picture for each position (metres along the route) as PNG, drawn when it is read; equal options, name and
/// positions give equal pictures on one machine. Fingerprints follow from these alone. Throws Error: an unknown name.
std::shared_ptr<Images> drawn_images(const DrawnOptions& options, const std::string& name,
                                     std::vector<float> positions);

}  // namespace citylearn
