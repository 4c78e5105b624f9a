// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace citylearn {

// Scans of a laser that turns on a car's roof, such as KITTI's Velodyne HDL-64E.
inline constexpr float kMinRange = 3;             ///< metres; what is nearer is the car itself
inline constexpr float kMaxRange = 80;            ///< metres, where KITTI's scans end; also means that nothing returned
inline constexpr float kMinReturnHeight = -1.2f;  ///< metres from the laser, 1.73 m above the road: kerbs are below
inline constexpr float kMaxReturnHeight = 1;      ///< metres from the laser

/// Returns the nearest range in each of `bins` equal bins of azimuth, in kMinRange..kMaxRange: the horizontal
/// distance to the nearest return whose height is in kMinReturnHeight..kMaxReturnHeight, which leaves out the road.
/// Bins begin straight behind and turn to the left, as those of ROS's LaserScan: bin `bins` / 2 begins straight ahead.
/// The file holds four little-endian floats a return: x ahead, y left, z up (metres) and reflectance. Throws Error
/// naming the file when it is not so or a number is not finite.
std::vector<float> nearest_ranges(const std::string& path, int bins);

}  // namespace citylearn
