// SPDX-License-Identifier: Apache-2.0
#include "env_service/geometry/geometry.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace citylearn {
namespace {

constexpr double kEarthRadius = 6'371'008.8;  // metres; mean radius of WGS 84

/// Sums distances between neighbours that are known.
template <class Distance>
std::vector<float> summed(const std::vector<double>& a, const std::vector<double>& b, Distance distance) {
  std::vector<float> metres(a.size(), std::numeric_limits<float>::quiet_NaN());
  double sum = 0;
  std::size_t last = a.size();
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!std::isfinite(a[i]) || !std::isfinite(b[i])) continue;
    if (last != a.size()) sum += distance(last, i);
    metres[i] = static_cast<float>(sum);
    last = i;
  }
  return metres;
}

}  // namespace

double metres_between(double latitude_a, double longitude_a, double latitude_b, double longitude_b) {
  // Haversine: exact for near points too.
  constexpr double kRadian = std::numbers::pi / 180;
  const double north = std::sin((latitude_b - latitude_a) * kRadian / 2);
  const double east = std::sin((longitude_b - longitude_a) * kRadian / 2);
  const double h = north * north + std::cos(latitude_a * kRadian) * std::cos(latitude_b * kRadian) * east * east;
  return 2 * kEarthRadius * std::asin(std::min(1.0, std::sqrt(h)));
}

std::vector<float> metres_along(const std::vector<double>& latitude, const std::vector<double>& longitude) {
  return summed(latitude, longitude, [&](std::size_t i, std::size_t j) {
    return metres_between(latitude[i], longitude[i], latitude[j], longitude[j]);
  });
}

std::vector<float> metres_along_plane(const std::vector<double>& x, const std::vector<double>& y,
                                      const std::vector<double>& z) {
  return summed(x, y, [&](std::size_t i, std::size_t j) {
    return z.empty() ? std::hypot(x[j] - x[i], y[j] - y[i]) : std::hypot(x[j] - x[i], y[j] - y[i], z[j] - z[i]);
  });
}

std::vector<double> interpolate(const std::vector<double>& times, const std::vector<double>& values,
                                const std::vector<double>& at, double reach) {
  std::vector<double> found(at.size(), std::numeric_limits<double>::quiet_NaN());
  if (times.empty()) return found;
  for (std::size_t i = 0; i < at.size(); ++i) {
    if (std::isnan(at[i])) continue;
    // The first sample after the moment: of equal times the later one lies before it.
    const auto after = static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), at[i]) - times.begin());
    if (after == 0) {
      if (times.front() - at[i] <= reach) found[i] = values.front();
    } else if (after == times.size()) {
      if (at[i] - times.back() <= reach) found[i] = values.back();
    } else {
      const double share = (at[i] - times[after - 1]) / (times[after] - times[after - 1]);
      // Not a + share (b - a): the sample itself comes out as it is, even beside a NaN.
      found[i] = share == 0 ? values[after - 1] : (1 - share) * values[after - 1] + share * values[after];
    }
  }
  return found;
}

}  // namespace citylearn
