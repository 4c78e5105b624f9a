// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/wire/messages.h"
#include "core/dds/middleware.h"
#include "dashboard/store/store.h"

namespace citylearn {

/// Which services there are and how they do, by their heartbeats. No wire and no clock of its own. Used by one thread
/// at a time.
class ServiceList {
 public:
  static constexpr std::chrono::seconds kSilence{2};     ///< then a service that has not said that it stops is lost
  static constexpr std::chrono::minutes kForgotten{60};  ///< after its last sign of life
  static constexpr std::size_t kMost = 1000;             ///< services; beyond, those silent for longest are forgotten

  /// Takes in a heartbeat; what it means goes to `events`.
  void hear(const msg::ServiceStatus& status, Clock::time_point now, std::vector<Event>& events);
  /// Notices who is silent. True when anybody's state changed.
  bool turn(Clock::time_point now, std::vector<Event>& events);
  /// The service lives, as far as is known. Of whoever never was heard, no.
  bool lives(const std::string& run, const std::string& id) const;
  /// As GET /api/services answers.
  nlohmann::json json(Clock::time_point now) const;

 private:
  struct Service {
    msg::ServiceStatus status;  ///< the newest
    const char* state = "starting";
    Clock::time_point heard;
    double since = 0;  ///< seconds since 1970, of the state
    bool silent = false;
  };
  static bool set(Service& service, const char* state);

  std::map<std::pair<std::string, std::string>, Service> services_;  // by run and id
};

}  // namespace citylearn
