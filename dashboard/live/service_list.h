// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/dds/middleware.h"
#include "core/exchange/incumbent.h"
#include "core/wire/messages.h"
#include "dashboard/store/store.h"

namespace citylearn {

/// Keeps the state of all services by their heartbeats. Has no access to the wire and no clock of its own. Used by one
/// thread at a time.
class ServiceList {
 public:
  static constexpr std::chrono::minutes kRemovalDelay{60};  ///< after its last heartbeat it is removed
  static constexpr std::size_t kMaxServices = 1000;         ///< services; beyond, those silent for longest are removed

  /// Takes a heartbeat; appends what it means to `events`.
  void on_message(const msg::ServiceStatus& status, Clock::time_point now, std::vector<Event>& events);
  /// Notices silent services. Returns true when any state changed.
  bool poll(Clock::time_point now, std::vector<Event>& events);
  /// Returns whether heartbeats of this service arrive.
  bool is_alive(const std::string& session, const std::string& id) const;
  /// Returns whether this service said last that it works.
  bool is_working(const std::string& session, const std::string& id) const;
  /// Returns whether a heartbeat of this service has arrived.
  bool knows(const std::string& session, const std::string& id) const { return services_.contains({session, id}); }
  /// Returns what GET /api/services answers.
  nlohmann::json json(Clock::time_point now) const;

 private:
  struct Service {
    msg::ServiceStatus status;  ///< the newest
    const char* state = "starting";
    Incumbent presence;
    double since = 0;  ///< seconds since 1970, of the state
    bool silent = false;
  };
  static bool set(Service& service, const char* state);

  std::map<std::pair<std::string, std::string>, Service> services_;  // by session and id
};

}  // namespace citylearn
