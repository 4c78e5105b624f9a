// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <list>
#include <unordered_map>
#include <utility>
#include <vector>

#include "env_service/drawn_city/drawn_images.h"
#include "env_service/drawn_city/painter.h"

// Lengths are metres; lateral ones grow to the right of the route.

namespace citylearn::drawn {

/// An upright surface of the world.
struct Thing {
  enum Face {
    kAlong,   ///< beside the route from s to s_end
    kAcross,  ///< across it at s, from lateral to lateral_end
    kUpright  ///< turned to the camera, around (s, lateral), lateral_end wide
  };
  Face face = kUpright;
  float s = 0, s_end = 0, lateral = 0, lateral_end = 0, bottom = 0, top = 0;
  float tint = 1;
  Skin skin;
};

enum class Zone { kCentre, kSuburb, kPark, kCountry };
inline constexpr float kCell = 12;  ///< metres of a cell

/// Some metres of the route with everything beside them.
struct Cell {
  Zone zone = Zone::kCentre;
  std::vector<Thing> things;             ///< the farthest first
  std::array<float, 2> front{}, roof{};  ///< left and right: distance and height of what throws shadows
  std::array<Colour, 2> field;           ///< what grows beyond the verge
  bool crossing = false;                 ///< zebra
  std::vector<cv::Vec4b> ground;         ///< by lateral, kGroundSteps a metre; the last channel is how it mirrors
};
inline constexpr int kGroundSteps = 8, kGroundReach = 40;  // metres to either side

class World {
 public:
  World(const DrawnOptions& options, const Look& look, std::uint64_t look_index);
  /// Returns the direction of the route in radians.
  float heading(float s) const;
  Zone zone(long cell) const;
  /// Valid until the next call.
  const Cell& cell(long index);
  const Painter& painter() const { return painter_; }

 private:
  Cell make(long index) const;
  void lay_ground(Cell& cell) const;
  void centre(Cell& cell, long index, int side) const;
  void suburb(Cell& cell, long index, int side) const;
  void green(Cell& cell, long index, int side) const;
  void roadside(Cell& cell, long index, int side) const;
  Random shape(long cell, int side, int purpose) const;
  Random mood(long cell, int side, int purpose) const;

  DrawnOptions options_;
  const Look& look_;
  std::uint64_t look_index_;
  Painter painter_;
  std::list<std::pair<long, Cell>> recent_;  // the newest first
  std::unordered_map<long, std::list<std::pair<long, Cell>>::iterator> cells_;
};

/// Returns smooth noise, -1..1, that changes over a distance of 1.
float noise(std::uint64_t stream, float x);
float noise(std::uint64_t stream, float x, float y);

}  // namespace citylearn::drawn
