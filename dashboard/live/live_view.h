// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "dashboard/store/rows.h"

namespace citylearn {

/// Gives the API its answers about live services, as JSON of docs/reference/dashboard-api.md. May be used by several
/// threads at once. Never waits for a message.
class LiveView {
 public:
  enum class Readiness {
    kHere,
    kComing,  ///< it is being fetched: ask again in a second
    kNone     ///< no live service has it
  };
  struct Map {
    Readiness readiness = Readiness::kNone;
    std::shared_ptr<const RouteMap> map = nullptr;
  };
  struct Picture {
    Readiness readiness = Readiness::kNone;
    std::string type, bytes;  ///< "image/jpeg"
  };
  virtual ~LiveView() = default;
  /// Returns what GET /api/services answers.
  virtual nlohmann::json services() = 0;
  /// Returns events that are not in the store, newest first, as in GET /api/events.
  virtual nlohmann::json events(std::size_t limit) = 0;
  /// Returns whether heartbeats of a service arrive; nothing when none of it ever came.
  virtual std::optional<bool> alive(const std::string& session, const std::string& id) = 0;
  /// Returns what the live env_services of `session` host, each as in "traversals" of GET /api/runs/ID.
  virtual nlohmann::json traversals(const std::string& session) = 0;
  virtual Map map(std::uint64_t hash) = 0;
  virtual Picture frame(std::uint64_t hash, std::uint32_t index) = 0;
};

}  // namespace citylearn
