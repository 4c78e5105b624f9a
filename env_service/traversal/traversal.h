// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/task/state_map.h"
#include "env_service/images/images.h"

namespace citylearn {

/// An ordered list of frames recorded once along a route under one condition, given by features or by images. As a
/// dataset loads it, frames are as they were recorded; once aligned to a sibling (selection.h), frame i of both shows
/// the same place. On streets frame i is what an agent sees in state i.
struct Traversal {
  std::string dataset;           ///< "plain", "synthetic"
  std::string name;              ///< unique within the dataset: "summer"
  std::string condition;         ///< "summer", "night" ...; empty when unknown
  int frames = 0;                ///< F
  int dimension = 0;             ///< D, features a frame; 0 when it has images
  std::vector<float> features;   ///< F x D, frame-major
  std::vector<float> positions;  ///< F, metres along the route; NaN where unknown

  std::shared_ptr<Images> images;  ///< F pictures; null when it has features
  std::vector<double> latitude;    ///< F, degrees north (WGS 84), NaN where unknown; or empty
  std::vector<double> longitude;   ///< F, degrees east, NaN where unknown; or empty
  std::vector<double> x, y;        ///< F, metres of any plane, as odometry has them, NaN where unknown; or empty
  std::vector<double> height;      ///< F, metres above any one level, NaN where unknown; or empty
  std::vector<double> times;       ///< F, seconds since any one moment, NaN where unknown; or empty
  std::vector<bool> unmatched;     ///< F, frames that show another place than a sibling's: no task is there; or empty
  std::shared_ptr<const StreetMap> streets;  ///< in order; null on a line
  StateRule rule = StateRule::kLine;         ///< which states there are, F
  int goal = -1;                             ///< place to which all tasks lead; -1: it is drawn
  std::string places_from;  ///< what tells where frames are, a file below the folder or "EXIF"; or empty
  std::vector<int> begins;  ///< the first frame of each recording, where several were joined; or empty

  std::span<const float> feature(int frame) const {
    return {features.data() + static_cast<std::size_t>(frame) * dimension, static_cast<std::size_t>(dimension)};
  }
  /// Returns the states of its streets; null on a line. Throws Error unless it has a frame for each.
  std::shared_ptr<const StateMap> states() const;
  /// Keeps `kept`, in that order, of the frames; indices may repeat. Leaves images as they are.
  void keep(const std::vector<int>& kept);
  /// Adds the frames of another recording behind these, and its name, "monday+tuesday". Throws Error where one has
  /// pictures or features that the other lacks, where one is on streets, and where the names are too long.
  void join(const Traversal& other);
  /// Returns the first 8 bytes of SHA-256 over dataset, F, D, features, positions, the images' fingerprints and streets
  /// with their rule, without the name.
  std::uint64_t hash() const;
};

}  // namespace citylearn
