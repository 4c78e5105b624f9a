// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <unordered_map>
#include <vector>

namespace citylearn {

/// Points of the earth on a plane in metres, near enough for distances of some hundred metres between them.
class Plane {
 public:
  explicit Plane(double latitude) : width_(std::cos(latitude * kDegree) * kEarth * kDegree) {}
  double x(double longitude) const { return longitude * width_; }
  double y(double latitude) const { return latitude * kEarth * kDegree; }

 private:
  static constexpr double kDegree = std::numbers::pi / 180;
  static constexpr double kEarth = 6'371'008.8;  // metres
  double width_;
};

/// Points in squares of side `side`: those within it of a place are in its square and the eight around it.
class Grid {
 public:
  explicit Grid(double side) : side_(side) {}
  void add(double x, double y, int frame) { squares_[key(square(x), square(y))].push_back({x, y, frame}); }

  struct Near {
    int frame;
    double metres;
  };
  /// Frames within `side`, by frame.
  void near(double x, double y, std::vector<Near>& found) const {
    found.clear();
    for (std::int64_t i = square(x) - 1; i <= square(x) + 1; ++i)
      for (std::int64_t j = square(y) - 1; j <= square(y) + 1; ++j)
        if (const auto points = squares_.find(key(i, j)); points != squares_.end())
          for (const Point& point : points->second)
            if (const double metres = std::hypot(point.x - x, point.y - y); metres <= side_)
              found.push_back({point.frame, metres});
    std::sort(found.begin(), found.end(), [](const Near& a, const Near& b) { return a.frame < b.frame; });
  }

 private:
  struct Point {
    double x, y;
    int frame;
  };
  std::int64_t square(double at) const { return static_cast<std::int64_t>(std::floor(at / side_)); }
  static std::int64_t key(std::int64_t i, std::int64_t j) {
    return static_cast<std::int64_t>(static_cast<std::uint64_t>(i) << 32 ^
                                     (static_cast<std::uint64_t>(j) & 0xFFFFFFFF));
  }

  double side_;
  std::unordered_map<std::int64_t, std::vector<Point>> squares_;
};

}  // namespace citylearn
