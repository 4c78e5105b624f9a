// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "core/metrics/metrics.h"
#include "core/util/machine.h"
#include "core/wire/messenger.h"

namespace citylearn {

/// One service on the wire: a Messenger with a heartbeat. Used by one thread at a time.
class Node : public Messenger {
 public:
  using Options = NodeOptions;
  /// Throws Error when the options are invalid.
  explicit Node(const Options& options);

  /// Waits until there may be a message to take, or the deadline has passed (returns false). Publishes due heartbeats
  /// and logs the middleware's faults.
  bool wait(Clock::time_point deadline);
  /// See Middleware::answer_at_once(). The handler may take and publish messages of types that have been created.
  void answer_at_once(const std::function<bool()>& handler) { middleware_->answer_at_once(handler); }
  /// Publishes a heartbeat when it is due. Returns when the next one is.
  Clock::time_point publish_heartbeat_if_due();
  /// Sets what the next heartbeats say; `rate`: environment steps per second. A changed state is published at once.
  void report(msg::State state, const std::string& activity, float rate = 0);
  /// Reports a problem ("the disk is full; the one before is kept") of `what` ("checkpoint"), once in the log and in
  /// every heartbeat, until called with an empty `problem`.
  void alarm(const std::string& what, const std::string& problem);
  /// Looks whether a heartbeat is of another process with this id. If so, throws Error when this process has just
  /// started and the other one is older, else raises an alarm.
  void check_twin(const msg::ServiceStatus& status);
  const Options& options() const { return options_; }
  DiscoveryMonitor& discovery() { return middleware_->discovery(); }
  std::string middleware_name() const { return middleware_->name(); }
  /// Returns the metrics for Prometheus. The node itself enters what its heartbeats say.
  Metrics& metrics() { return metrics_; }

 private:
  void heartbeat();

  msg::ServiceStatus status_;
  ProcessUse use_;  // at the last heartbeat
  Clock::time_point started_, next_heartbeat_, twin_heard_;
  std::map<std::string, std::string> alarms_;
  Metrics metrics_;
};

}  // namespace citylearn
