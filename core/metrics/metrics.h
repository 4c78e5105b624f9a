// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "idl/forward.h"

namespace citylearn {

class MetricsServer;

/// Returns why `text` is not [ADDRESS:]PORT, an IPv4 address and a port; empty when it is, or when it is empty.
std::string metrics_address_problem(const std::string& text);

/// Metrics of a service for Prometheus and health probes: its last heartbeat, its last update of training, and its
/// queues. Serves GET /metrics, /healthz and /livez over HTTP on a thread of its own. Used by any thread.
class Metrics {
 public:
  /// Listens at `address`, "[ADDRESS:]PORT"; without ADDRESS on 127.0.0.1 alone, at port 0 on a free port. Serves
  /// nothing when it is empty. Throws Error when it cannot listen there.
  explicit Metrics(const std::string& address);
  ~Metrics();

  /// Takes in a heartbeat: the main loop turns.
  void set(const msg::ServiceStatus& status);
  void set(const msg::TrainingStat& stat);
  /// `name` is one of few, in lower case: "episodes".
  void set_queue(const std::string& name, std::uint64_t length, std::uint64_t capacity);

  /// Returns all of it in Prometheus' text format.
  std::string text() const;
  /// Returns why the service is unhealthy: no heartbeat for kSilence, a failure or, if they count, an alarm; else "".
  std::string problem(bool alarms) const;

 private:
  struct Values;
  const std::unique_ptr<Values> values_;
  std::unique_ptr<MetricsServer> server_;
};

}  // namespace citylearn
