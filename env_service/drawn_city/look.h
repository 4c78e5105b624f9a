// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace citylearn::drawn {

/// BGR, 0..255.
using Colour = cv::Vec3f;

/// The appearance of the drawn world in one recording: season, weather, light, and how the car drives.
struct Look {
  std::string name;
  int leaves = 0;               ///< 0 green, 1 of autumn, 2 none
  float snow = 0;               ///< 0..1, on ground and roofs
  float wet = 0;                ///< 0..1, how the ground mirrors
  bool night = false;           ///< lamps, lit windows, headlights
  float sun_azimuth = 0;        ///< radians; 0 is the direction in which the route begins, positive to the right
  float sun_elevation = 0.7f;   ///< radians
  float sun = 0.6f;             ///< share of direct light
  Colour light{255, 255, 255};  ///< colour of what lights a white surface
  Colour zenith{230, 150, 80}, horizon{245, 225, 200}, cloud{250, 250, 250};
  float clouds = 0.4f;           ///< share of the sky
  float sight = 260;             ///< metres at which things are mostly haze
  float noise = 3;               ///< standard deviation of a pixel, of 255
  Colour gain{1, 1, 1};          ///< white balance and exposure
  float rain = 0, snowfall = 0;  ///< streaks and flakes, 0..1
  float sway = 1;                ///< how unsteadily it is driven
  float lateral = 0, yaw = 0;    ///< of the camera: metres, radians
};
/// Returns all looks, in the order of drawn_names().
const std::vector<Look>& looks();

}  // namespace citylearn::drawn
