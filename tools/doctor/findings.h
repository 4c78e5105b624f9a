// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/wire/messages.h"
#include "core/dds/middleware.h"
#include "core/dds/middleware_internal.h"
#include "tools/doctor/host.h"

namespace citylearn::doctor {

/// What the heartbeats of a domain tell. Joins no run and sends nothing.
class Heartbeats {
 public:
  struct Service {
    msg::ServiceStatus newest;
    int heard = 0;     ///< heartbeats of this incarnation
    double ahead = 0;  ///< seconds that the sender's clock is before ours
  };

  explicit Heartbeats(Middleware& middleware);
  /// Takes what has come.
  void take();
  /// By run and id; of one that was started again, the newest.
  const std::map<std::pair<std::string, std::string>, Service>& services() const { return services_; }
  /// Why messages could not be read, each once: "citylearn::msg::ServiceStatus, protocol: the sender speaks ...".
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
  std::vector<std::string> problems;  ///< a line each; none: all is well
  std::vector<std::string> hints;     ///< what may become a problem, and what to do
};

/// Looks around for so many seconds (less when told to stop).
Findings examine(const MiddlewareOptions& options, const std::string& run, double seconds);

std::string as_text(const Findings& findings);
std::string as_json(const Findings& findings);

/// Waits for a heartbeat of service `id` (of `run`, unless that is empty) that is fresh and whose state is not FAILED.
/// Returns what is wrong instead, or an empty text.
std::string check_service(const MiddlewareOptions& options, const std::string& run, const std::string& id,
                          double seconds);

}  // namespace citylearn::doctor
