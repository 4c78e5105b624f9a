// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace citylearn {

/// Metres along a route through these points (degrees, WGS 84; great circles on a sphere of 6,371,008.8 m). NaN at NaN,
/// which is skipped. A vehicle that stands does not get on, though its places do: where a route
/// turns back 6 times or more, twice within 30 m each, what stays within 4 of its legs (and 5 m on the earth) of the
/// place before does not count. Exact routes keep their metres, as this holds where it leaves out 10 m or more.
std::vector<float> metres_along(const std::vector<double>& latitude, const std::vector<double>& longitude);
/// Metres along a route through points in metres, of a plane or of space (`z` given).
std::vector<float> metres_along_plane(const std::vector<double>& x, const std::vector<double>& y,
                                      const std::vector<double>& z = {});
/// Metres between two points of the earth.
double metres_between(double latitude_a, double longitude_a, double latitude_b, double longitude_b);
/// Degrees clockwise from north, -180..180, in which a great circle leaves a for b; they must not be one place.
double heading_between(double latitude_a, double longitude_a, double latitude_b, double longitude_b);

/// A place on the earth, degrees (WGS 84).
struct LatLon {
  double latitude, longitude;
};
/// Returns the place of UTM coordinates (metres) of a zone 1..60 in the north or the south, to the millimetre.
LatLon from_utm(double easting, double northing, int zone, bool north);

/// Returns the values at `at`, linear between the samples (times must not fall; of equal ones the later counts). NaN
/// outside of them by more than `reach` seconds; within it the nearest sample.
std::vector<double> interpolate(const std::vector<double>& times, const std::vector<double>& values,
                                const std::vector<double>& at, double reach);
/// Likewise for degrees east, the shorter way round the earth.
std::vector<double> interpolate_longitude(const std::vector<double>& times, std::vector<double> degrees,
                                          const std::vector<double>& at, double reach);

}  // namespace citylearn
