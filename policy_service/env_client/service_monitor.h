// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/exchange/presence.h"
#include "core/wire/messages.h"

namespace citylearn {

/// Knows the living policy_services and encoder_services of the session by their heartbeats, and the env_services whose
/// images no encoder_service has completed yet. Used by one thread.
class ServiceMonitor {
 public:
  struct Service {
    std::string id, service, activity;
    bool working = false;
    Presence presence;
  };
  void on_status(const msg::ServiceStatus& status);
  /// Notes that an env_service announced images without features.
  void on_images(const msg::TraversalInfo& info) {
    unencoded_[info.header().sender().c_str()] = {info.traversal().c_str(), Presence(Clock::now())};
  }
  /// Notes that an env_service's announcement is complete.
  void on_complete(const msg::Header& env) { unencoded_.erase(env.sender().c_str()); }

  /// Returns the id of this process of a service; empty unless it is alive.
  std::string id_of(std::uint64_t incarnation) const;
  /// Returns the encoder_services that are alive.
  std::vector<Service> encoders() const;
  /// Returns the traversals that wait for an encoder_service, by the id of their env_service.
  std::map<std::string, std::string> unencoded() const;

 private:
  static constexpr std::size_t kMaxServices = 256;
  struct Images {
    std::string traversal;
    Presence presence;
  };
  std::map<std::uint64_t, Service> services_;  ///< by incarnation
  std::map<std::string, Images> unencoded_;    ///< by id of the env_service
};

}  // namespace citylearn
