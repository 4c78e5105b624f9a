// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace citylearn::testing {

/// Returns the path of real recordings or networks: below $CITYLEARN_DATA, or shared/data beside the folder of the
/// sources. Empty where there is none.
inline std::string real_data(const std::string& source, const std::string& name) {
  const char* given = std::getenv("CITYLEARN_DATA");
  const std::string path = (given && *given ? std::string(given) : source + "/../shared/data") + "/" + name;
  return std::filesystem::exists(path) ? path : "";
}

}  // namespace citylearn::testing
