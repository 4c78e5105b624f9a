// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "env_service/drawn_city/world.h"

namespace citylearn::drawn {

/// Draws what a camera on the route sees. The buffer is twice as wide and high as the picture.
class Camera {
 public:
  Camera(const DrawnOptions& options, const Look& look, std::uint64_t look_index);
  /// Valid until the next call.
  const cv::Mat& draw(float s);
  float heading(float s) const { return world_.heading(s); }  ///< of the route, radians

 private:
  static constexpr float kAhead = 216;                                            // metres of the route that are drawn
  static constexpr float kEye = 1.9f;                                             // metres above the ground
  enum Stream : std::uint64_t { kClouds = 41, kHills, kSway, kStars, kTraffic };  // of random numbers

  static uchar byte(int value) { return static_cast<uchar>(std::clamp(value, 0, 255)); }

  struct Point {
    float x = 0, z = 0;
  };
  struct Place : Point {  // of the route
    float turn = 0;       // relative to the camera
  };
  /// Returns the light that falls onto something, of 256 a channel; `direct` is the share of sunlight, 0..1.
  cv::Vec3i light(float direct, Point at) const;
  void survey(float s);
  Place at(float s) const;
  Point beside(float s, float lateral) const;
  void paint_sky();
  void draw_sky(float s);
  void draw_ground(float s);
  void draw_things(float s);
  void draw_shadow(const Thing& thing);
  void draw_traffic(float s, long cell);
  void draw_thing(const Thing& thing);
  void draw_wall(const Thing& thing, Point a, Point b, float direct);
  void mirror();
  void fall(Random& random);
  void develop(Random& random);

  const DrawnOptions options_;
  const Look& look_;
  const std::uint64_t look_index_;
  World world_;
  int width_, height_, level_, horizon_;  // of the buffer; the horizon of a level camera, and now
  float focal_, centre_;
  float begin_ = 0, heading_ = 0;
  std::vector<Place> route_;
  std::vector<int> haze_, fade_;  // by metres, of 256
  std::vector<int> grain_;
  std::array<Skin, 6> traffic_;  // from behind three times, from the front three times
  cv::Mat sky_, buffer_, picture_;
};

}  // namespace citylearn::drawn
