// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "env_service/images/images.h"

// A drive through a generated city and its countryside, drawn frame by frame. The world follows from the seed and the
// place along the route; season, weather, parked cars and lit windows follow from the look of the recording.

namespace citylearn {

struct DrawnOptions {
  int width = 160, height = 96;  ///< pixels of a picture
  std::uint64_t seed = 1;        ///< another seed, another city
  double countryside = 0.35;     ///< share of the route outside of the city, 0..1
  double viewpoint = 1.5;        ///< metres by which the camera of "shifted" drives further left
};

/// Returns the names of the recordings: "summer", "fall", "winter", "night", "overcast", "rain", "shifted".
const std::vector<std::string>& drawn_names();

/// Draws what the camera of a car sees that drives through the city. Used by one thread.
class DrawnDrive {
 public:
  /// Throws Error when the name is unknown.
  DrawnDrive(const DrawnOptions& options, const std::string& name);
  ~DrawnDrive();

  /// Draws the picture at a place, metres along the route, as a PNG file.
  void draw(float metres, Bytes& file);
  /// Returns the direction of the route, radians.
  float heading(float metres) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Draws a picture for each position (metres along the route) as PNG, when it is read. Equal options, name and
/// positions give equal pictures on one machine; fingerprints follow from these alone. Throws Error when the name is
/// unknown.
std::shared_ptr<Images> drawn_images(const DrawnOptions& options, const std::string& name,
                                     std::vector<float> positions);

}  // namespace citylearn
