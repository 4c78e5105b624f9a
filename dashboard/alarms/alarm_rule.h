// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace citylearn {

/// What of a run raises an alarm (docs/reference/dashboard-api.md, "Alarms").
struct AlarmRule {
  enum class When {
    kBelow,      ///< the figure is less than `value`
    kAbove,      ///< it is greater
    kNotFinite,  ///< it is infinite, or no number
    kSilent,     ///< no new point of the figure, or of any, for `minutes`
    kLost        ///< the run is lost: it has not ended, and nothing is heard of it
  };
  std::int64_t id = 0;       ///< 0: not made yet
  std::string runs = "*";    ///< ID of a run, a pattern of IDs (* and ?), or a tag
  When when = When::kBelow;  //
  std::string figure;        ///< of TrainingStat, or a metric; empty where it does not matter
  double value = 0;          ///< of kBelow and kAbove
  std::uint64_t points = 1;  ///< in succession that it takes, of kBelow, kAbove and kNotFinite
  double steps = 0;          ///< over which they stretch, at least
  double minutes = 0;        ///< of kSilent
  double created = 0;        ///< seconds since 1970
};

/// Bounds of alarms.
inline constexpr std::size_t kMostAlarmRules = 100, kLongestAlarmRuns = 512;

/// Returns "below", "above", "not_finite", "silent" or "lost".
const char* name_of(AlarmRule::When when);
/// Returns what name_of() calls so, or nothing.
std::optional<AlarmRule::When> when_of(std::string_view name);

/// Returns whether the rule counts points of its figure.
bool counts_points(const AlarmRule& rule);

/// Returns the rule in words, without its runs: "spl below 0.5 for 10 points".
std::string described(const AlarmRule& rule);

/// Returns what is wrong with a rule, or nothing.
std::optional<std::string> fault_of(const AlarmRule& rule);

/// Returns whether the rule is for a run of this ID and these tags, of which each stands on a line.
bool watches(const AlarmRule& rule, const std::string& run, const std::string& tags);

}  // namespace citylearn
