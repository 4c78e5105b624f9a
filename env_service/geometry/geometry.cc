// SPDX-License-Identifier: Apache-2.0
#include "env_service/geometry/geometry.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "env_service/geometry/plane.h"

namespace citylearn {
namespace {

constexpr double kMaxLegs = 30, kMinNoise = 10;  // metres: of two legs of a vehicle that stands; that these add
constexpr std::size_t kMinTurns = 6;

/// Forgets, of the points of a route, those that are the noise of a vehicle that stands.
template <class Distance>
void forget_noise(std::vector<std::size_t>& points, double noise, Distance distance) {
  std::vector<double> along(points.size());
  std::vector<std::size_t> turns;  // points where it turns back
  double before = kMaxLegs;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const double after = distance(points[i], points[i + 1]);
    along[i + 1] = along[i] + after;
    if (before < kMaxLegs && after < kMaxLegs &&
        std::pow(distance(points[i - 1], points[i + 1]), 2) < before * before + after * after)
      turns.push_back(i);
    before = after;
  }
  std::vector<bool> kept(points.size(), true);
  for (std::size_t first = 0, last = 0; first < turns.size(); first = last + 1) {
    last = first;
    while (last + 2 < turns.size() && along[turns[last + 2]] - along[turns[last]] < kMaxLegs) ++last;
    if (++last - first + 1 < kMinTurns || last == turns.size()) continue;
    const std::size_t begin = turns[first] - 1, end = turns[last];
    const double leg = (along[end] - along[turns[first]]) / static_cast<double>(last - first);
    std::vector<std::size_t> still;
    double metres = along[end] - along[begin];  // that noise adds
    for (std::size_t i = begin + 1, anchor = begin; i <= end; ++i)
      if (const double away = distance(points[anchor], points[i]); away > std::max(noise, 4 * leg)) {
        metres -= away;
        anchor = i;
      } else {
        still.push_back(i);
      }
    for (std::size_t i = 0; metres >= kMinNoise && i < still.size(); ++i) kept[still[i]] = false;
  }
  std::erase_if(points, [&, i = std::size_t{0}](std::size_t) mutable { return !kept[i++]; });
}

/// Sums distances between neighbours that are known.
template <class Distance>
std::vector<float> summed(const std::vector<double>& a, const std::vector<double>& b, double noise, Distance distance) {
  const auto known = [&](std::size_t i) { return std::isfinite(a[i]) && std::isfinite(b[i]); };
  std::vector<std::size_t> points;  // that differ from the one before
  for (std::size_t i = 0; i < a.size(); ++i)
    if (known(i) && (points.empty() || distance(points.back(), i) > 0)) points.push_back(i);
  forget_noise(points, noise, distance);
  std::vector<float> metres(a.size(), std::numeric_limits<float>::quiet_NaN());
  double sum = 0;
  for (std::size_t i = 0, next = 0; i < a.size(); ++i) {
    if (!known(i)) continue;
    if (next < points.size() && points[next] == i && next++ > 0) sum += distance(points[next - 2], i);
    metres[i] = static_cast<float>(sum);
  }
  return metres;
}

}  // namespace

double metres_between(double latitude_a, double longitude_a, double latitude_b, double longitude_b) {
  // Haversine: exact for near points too.
  const double north = std::sin((latitude_b - latitude_a) * kDegree / 2);
  const double east = std::sin((longitude_b - longitude_a) * kDegree / 2);
  const double h = north * north + std::cos(latitude_a * kDegree) * std::cos(latitude_b * kDegree) * east * east;
  return 2 * kEarthRadius * std::asin(std::min(1.0, std::sqrt(h)));
}

double heading_between(double latitude_a, double longitude_a, double latitude_b, double longitude_b) {
  // cos a sin b - sin a cos b cos(east), without the cancellation that near points have in it.
  const double a = latitude_a * kDegree, b = latitude_b * kDegree, east = (longitude_b - longitude_a) * kDegree;
  const double bend = 2 * std::pow(std::sin(east / 2), 2);
  return std::atan2(std::sin(east) * std::cos(b), std::sin(b - a) + std::sin(a) * std::cos(b) * bend) / kDegree;
}

std::vector<float> metres_along(const std::vector<double>& latitude, const std::vector<double>& longitude) {
  return summed(latitude, longitude, 5, [&](std::size_t i, std::size_t j) {
    return metres_between(latitude[i], longitude[i], latitude[j], longitude[j]);
  });
}

std::vector<float> metres_along_plane(const std::vector<double>& x, const std::vector<double>& y,
                                      const std::vector<double>& z) {
  return summed(x, y, 0, [&](std::size_t i, std::size_t j) {
    return z.empty() ? std::hypot(x[j] - x[i], y[j] - y[i]) : std::hypot(x[j] - x[i], y[j] - y[i], z[j] - z[i]);
  });
}

LatLon from_utm(double easting, double northing, int zone, bool north) {
  // Krueger's series in the third flattening n, to its third order (Karney, Transverse Mercator with an accuracy of a
  // few nanometers, 2011, equations 11, 14 and 36); latitude from the conformal one by Newton's method (equations 19 to
  // 21).
  const double a = 6378137, f = 1 / 298.257223563, n = f / (2 - f);
  const double radius = a / (1 + n) * (1 + n * n / 4 + n * n * n * n / 64) * 0.9996;
  const double beta[] = {n / 2 - 2 * n * n / 3 + 37 * n * n * n / 96, n * n / 48 + n * n * n / 15,
                         17 * n * n * n / 480};
  const double xi = (northing - (north ? 0 : 1e7)) / radius, eta = (easting - 500'000) / radius;
  double x = xi, y = eta;
  for (int j = 1; j <= 3; ++j) {
    x -= beta[j - 1] * std::sin(2 * j * xi) * std::cosh(2 * j * eta);
    y -= beta[j - 1] * std::cos(2 * j * xi) * std::sinh(2 * j * eta);
  }
  const double e2 = f * (2 - f), e = std::sqrt(e2), wanted = std::sin(x) / std::hypot(std::sinh(y), std::cos(x));
  double tangent = wanted;
  for (int i = 0; i < 5; ++i) {
    const double secant = std::hypot(1, tangent), sigma = std::sinh(e * std::atanh(e * tangent / secant));
    const double now = tangent * std::hypot(1, sigma) - sigma * secant;
    tangent += (wanted - now) / std::hypot(1, now) * (1 + (1 - e2) * tangent * tangent) / ((1 - e2) * secant);
  }
  const double east = std::atan2(std::sinh(y), std::cos(x)) / kDegree + 6 * zone - 183;
  return {std::atan(tangent) / kDegree, std::remainder(east, 360)};
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

std::vector<double> interpolate_longitude(const std::vector<double>& times, std::vector<double> degrees,
                                          const std::vector<double>& at, double reach) {
  double last = 0, turns = 0;
  for (double& degree : degrees) {
    if (std::isnan(degree)) continue;
    if (std::abs(degree + turns - last) > 180) turns += degree + turns > last ? -360 : 360;
    last = degree += turns;
  }
  std::vector<double> found = interpolate(times, degrees, at, reach);
  for (double& degree : found) degree = std::remainder(degree, 360);
  return found;
}

}  // namespace citylearn
