// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/dds/middleware.h"
#include "core/dds/middleware_internal.h"
#include "core/wire/messages.h"
#include "tools/doctor/host.h"

namespace citylearn::doctor {

/// Collects the heartbeats of a domain. Joins no session and sends nothing.
class Heartbeats {
 public:
  struct Service {
    msg::ServiceStatus newest;
    int heard = 0;     ///< heartbeats of this incarnation
    double ahead = 0;  ///< seconds by which the sender's clock is ahead of ours
  };

  explicit Heartbeats(Middleware& middleware);
  /// Takes the heartbeats that have come.
  void take();
  /// Returns the services by session and id; of one that was restarted, the newest.
  const std::map<std::pair<std::string, std::string>, Service>& services() const { return services_; }
  /// Reasons for unreadable messages, each once: "citylearn::msg::ServiceStatus, protocol: the sender speaks ...".
  const std::set<std::string>& unreadable() const { return unreadable_; }

 private:
  const std::unique_ptr<Subscription> subscription_;
  std::map<std::pair<std::string, std::string>, Service> services_;
  std::set<std::string> unreadable_;
  Bytes buffer_;
  msg::ServiceStatus status_;
};

struct Findings {
  std::vector<internal::Interface> interfaces;
  std::set<std::string> used;  ///< addresses of the interfaces that --interface names
  std::string middleware;
  std::uint32_t domain = 0;
  int first_port = 0, last_port = 0;
  std::vector<Port> ports;
  std::vector<DiscoveryMonitor::Participant> participants;
  std::vector<Heartbeats::Service> services;
  std::vector<std::string> problems;  ///< a line each
  std::vector<std::string> hints;     ///< what may become a problem, and what to do
};

/// Examines this host and the domain for `seconds` (less when asked to stop).
Findings examine(const MiddlewareOptions& options, const std::string& session, double seconds);

std::string as_text(const Findings& findings);
std::string as_json(const Findings& findings);

/// Waits for a fresh heartbeat of service `id` (of `session`, unless that is empty) whose state is not FAILED.
/// Returns what is wrong otherwise, or an empty text.
std::string check_service(const MiddlewareOptions& options, const std::string& session, const std::string& id,
                          double seconds);

}  // namespace citylearn::doctor
