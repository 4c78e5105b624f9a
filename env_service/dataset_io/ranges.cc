// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/ranges.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "core/files/files.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxScanBytes = std::size_t{256} << 20;  // bytes; real ones have 2 MiB

}  // namespace

std::vector<float> nearest_ranges(const std::string& path, int bins) {
  const std::string bytes = read_file(path, kMaxScanBytes);
  float point[4];  // x, y, z, reflectance
  if (bytes.size() % sizeof point != 0)
    throw Error("is not a laser scan: " + std::to_string(bytes.size()) + " bytes are no whole number of returns, " +
                    std::to_string(sizeof point) + " bytes each",
                path, "fetch it again");
  std::vector<float> nearest(static_cast<std::size_t>(bins), kMaxRange);
  for (std::size_t at = 0; at < bytes.size(); at += sizeof point) {
    std::memcpy(point, bytes.data() + at, sizeof point);
    const auto [x, y, z, reflectance] = point;
    if (!std::isfinite(x) || !std::isfinite(y) || !std::isfinite(z))
      throw Error("return " + std::to_string(at / sizeof point) + " has a place that is not finite", path,
                  "fetch it again");
    const float range = std::hypot(x, y);
    if (z < kMinReturnHeight || z > kMaxReturnHeight || range < kMinRange) continue;
    const double turn = (std::atan2(y, x) + std::numbers::pi) / (2 * std::numbers::pi);  // 0..1, both straight behind
    float& bin = nearest[static_cast<std::size_t>(turn * bins) % nearest.size()];
    bin = std::min(bin, range);
  }
  return nearest;
}

}  // namespace citylearn
