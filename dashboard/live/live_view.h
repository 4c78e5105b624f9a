// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

namespace citylearn {

/// What the API asks of what is alive now, in the shapes of docs/reference/dashboard-api.md. Used by several threads at
/// once; never waits for the wire.
class LiveView {
 public:
  enum class Readiness {
    kHere,
    kComing,  ///< it is being fetched: ask again in a second
    kNone     ///< nobody has it, as far as is known
  };
  struct Map {
    Readiness readiness = Readiness::kNone;
    nlohmann::json json;  ///< as GET /api/map/HASH answers
  };
  struct Picture {
    Readiness readiness = Readiness::kNone;
    std::string type, bytes;  ///< "image/jpeg"
  };
  virtual ~LiveView() = default;
  /// As GET /api/services answers.
  virtual nlohmann::json services() = 0;
  /// Events that are not in the store, newest first, as in GET /api/events.
  virtual nlohmann::json events(std::size_t limit) = 0;
  /// What the env_services of `run` that are there host, each as in "traversals" of GET /api/runs/ID.
  virtual nlohmann::json traversals(const std::string& run) = 0;
  virtual Map map(std::uint64_t hash) = 0;
  virtual Picture frame(std::uint64_t hash, std::uint32_t index) = 0;
};

}  // namespace citylearn
