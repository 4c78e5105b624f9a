// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

#include "tests/support/files.h"

namespace citylearn::testing {

/// Writes a laser scan as KITTI stores it: x, y, z of each return (metres) and a reflectance.
inline void write_scan(const std::string& path, const std::vector<std::array<float, 3>>& returns) {
  std::string bytes;
  for (const auto& [x, y, z] : returns) {
    const float numbers[] = {x, y, z, 0.5f};
    bytes.append(reinterpret_cast<const char*>(numbers), sizeof numbers);
  }
  make_file(path, bytes);
}

}  // namespace citylearn::testing
