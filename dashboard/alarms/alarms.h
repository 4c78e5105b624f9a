// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dashboard/alarms/alarm_rule.h"
#include "dashboard/store/store.h"

namespace citylearn {

/// An alarm of a run.
struct RunAlarm {
  std::int64_t id = 0, rule = 0;
  std::string run;  ///< its ID
  double since = 0;
  std::optional<double> over;  ///< seconds since 1970; nothing: it lasts
  std::string text;            ///< what happened
};

/// Raises alarms about runs by rules that people made. Rules and alarms are in the store; each alarm is raised once,
/// also when the dashboard is killed meanwhile. A thread reads the points that have come since it looked last, over a
/// connection of its own. May be used by several threads.
///
/// A rule looks at runs that were heard of after it was made: at the points that come from then on, and at as many
/// before as it counts. An alarm is over once as many points in succession do not fit the rule, or the run has ended.
class Alarms {
 public:
  struct Options {
    std::chrono::milliseconds period{1000};  ///< between two looks; 0: only poll() looks
    std::function<double()> now;             ///< seconds since 1970; unset: the clock
    /// Called for each alarm that is raised or over, once that is in the store: the event that is there too. Called by
    /// the thread that looks, or by that which makes a rule; may be unset.
    std::function<void(const Event&)> on_event{};
    std::function<void(Alarms&)> on_change{};  ///< likewise, after each change of rules and alarms
  };
  /// `store` must outlive it. Throws Error when the store cannot be read.
  Alarms(Store& store, Options options);
  explicit Alarms(Store& store) : Alarms(store, Options()) {}
  ~Alarms();

  /// Returns why a rule cannot be made: something is wrong with it, the runs that it watches have no such figure, or
  /// there are too many rules. Returns nothing when it can.
  std::optional<std::string> refusal(const AlarmRule& rule);
  /// Makes a rule, which refusal() has passed, and returns it with its ID. Throws Error when the store cannot be
  /// written.
  AlarmRule add(AlarmRule rule);
  /// Removes a rule and its alarms. Returns false when there is none.
  bool remove(std::int64_t rule);
  /// Ends an alarm by hand. It is raised again only after its cause has gone. Returns false when none of this ID lasts.
  bool dismiss(std::int64_t alarm);

  std::vector<AlarmRule> rules();  ///< in the order in which they were made
  std::vector<RunAlarm> alarms();  ///< those that last, then others, each newest first; at most 200

  /// Looks at what is new.
  void poll();

  /// Returns lines for /metrics: the alarms that last.
  std::string metrics();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
