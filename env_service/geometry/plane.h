// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <unordered_map>
#include <utility>
#include <vector>

namespace citylearn {

inline constexpr double kEarthRadius = 6'371'008.8;  ///< metres; mean radius of WGS 84
inline constexpr double kDegree = std::numbers::pi / 180;

/// A point in space, metres.
struct Point {
  double x, y = 0, z = 0;
};
/// Returns the point of the earth from its middle: distances are right everywhere, at longitude 180 and the poles too.
inline Point on_earth(double latitude, double longitude) {
  const double out = kEarthRadius * std::cos(latitude * kDegree);
  return {out * std::cos(longitude * kDegree), out * std::sin(longitude * kDegree),
          kEarthRadius * std::sin(latitude * kDegree)};
}
inline double metres_between(const Point& a, const Point& b) { return std::hypot(a.x - b.x, a.y - b.y, a.z - b.z); }

/// Points in cubes of side `side`: those within it of a place are in its cube and those around it.
class Grid {
 public:
  explicit Grid(double side) : side_(side) {}
  void add(const Point& point, int frame) {
    cubes_[key(cube(point.x), cube(point.y), cube(point.z))].push_back({point, frame});
  }

  struct Near {
    int frame;
    double metres;
  };
  /// Finds the frames within `side`, by frame.
  void near(const Point& point, std::vector<Near>& found) const {
    found.clear();
    for (int around = 0; around < 27; ++around) {
      const auto places = cubes_.find(
          key(cube(point.x) + around / 9 - 1, cube(point.y) + around / 3 % 3 - 1, cube(point.z) + around % 3 - 1));
      if (places == cubes_.end()) continue;
      for (const auto& [place, frame] : places->second)
        if (const double metres = metres_between(place, point); metres <= side_) found.push_back({frame, metres});
    }
    std::sort(found.begin(), found.end(), [](const Near& a, const Near& b) { return a.frame < b.frame; });
  }

 private:
  std::uint64_t cube(double at) const {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(at / side_)));
  }
  /// Returns a number that differs for cubes near each other.
  static std::uint64_t key(std::uint64_t i, std::uint64_t j, std::uint64_t k) {
    return i * 0x9E3779B97F4A7C15 + j * 0xC2B2AE3D27D4EB4F + k * 0x165667B19E3779F9;
  }

  double side_;
  std::unordered_map<std::uint64_t, std::vector<std::pair<Point, int>>> cubes_;
};

}  // namespace citylearn
