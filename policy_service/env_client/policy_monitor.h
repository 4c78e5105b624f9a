// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "core/exchange/presence.h"
#include "core/wire/messages.h"

namespace citylearn {

/// Knows the living policy_services of the session by their heartbeats. Used by one thread.
class PolicyMonitor {
 public:
  void on_status(const msg::ServiceStatus& status) {
    if (std::string(status.service().c_str()) != "policy_service") return;
    const std::uint64_t incarnation = status.header().incarnation();
    if (status.service_state() == msg::STOPPING || status.service_state() == msg::FAILED) {
      policies_.erase(incarnation);
      return;
    }
    const Clock::time_point now = Clock::now();
    if (policies_.size() >= kMaxPolicies)
      std::erase_if(policies_, [now](const auto& entry) { return !entry.second.presence.here(now); });
    if (policies_.size() < kMaxPolicies || policies_.contains(incarnation))
      policies_[incarnation] = {status.header().sender().c_str(), Presence(now)};
  }
  /// Returns the id of this process of a policy_service; empty unless it is alive.
  std::string id_of(std::uint64_t incarnation) const {
    const auto found = policies_.find(incarnation);
    return found != policies_.end() && found->second.presence.here(Clock::now()) ? found->second.id : "";
  }

 private:
  static constexpr std::size_t kMaxPolicies = 256;
  struct Policy {
    std::string id;
    Presence presence;
  };
  std::map<std::uint64_t, Policy> policies_;  // by incarnation
};

}  // namespace citylearn
