// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace citylearn {

/// Metres along a route through these points (degrees, WGS 84; great circles on a sphere of 6,371,008.8 m). NaN at NaN,
/// which is skipped.
std::vector<float> metres_along(const std::vector<double>& latitude, const std::vector<double>& longitude);
/// Metres along a route through points in metres, of a plane or of space (`z` given).
std::vector<float> metres_along_plane(const std::vector<double>& x, const std::vector<double>& y,
                                      const std::vector<double>& z = {});
/// Metres between two points of the earth.
double metres_between(double latitude_a, double longitude_a, double latitude_b, double longitude_b);

/// Returns the values at `at`, linear between the samples (times must not fall; of equal ones the later counts). NaN
/// outside of them by more than `reach` seconds; within it the nearest sample.
std::vector<double> interpolate(const std::vector<double>& times, const std::vector<double>& values,
                                const std::vector<double>& at, double reach);

}  // namespace citylearn
