// SPDX-License-Identifier: Apache-2.0
#include "dashboard/alarms/alarm_rule.h"

#include <fnmatch.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "dashboard/logged/logged_runs.h"

namespace citylearn {
namespace {

using When = AlarmRule::When;

constexpr std::array<const char*, 5> kNames = {"below", "above", "not_finite", "silent", "lost"};
constexpr std::uint64_t kMostPoints = 1'000'000;
constexpr double kMostSteps = 1e15, kLeastMinutes = 0.05, kMostMinutes = 7 * 24 * 60;

}  // namespace

const char* name_of(When when) { return kNames[static_cast<std::size_t>(when)]; }

std::optional<When> when_of(std::string_view name) {
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end()) return std::nullopt;
  return static_cast<When>(found - kNames.begin());
}

bool counts_points(const AlarmRule& rule) {
  return rule.when == When::kBelow || rule.when == When::kAbove || rule.when == When::kNotFinite;
}

std::string described(const AlarmRule& rule) {
  if (rule.when == When::kLost) return "the run is lost";
  if (rule.when == When::kSilent)
    return fmt::format("no new point{} for {:g} min", rule.figure.empty() ? "" : " of " + rule.figure, rule.minutes);
  std::string text = rule.when == When::kNotFinite
                         ? rule.figure + " is not finite"
                         : fmt::format("{} {} {:g}", rule.figure, name_of(rule.when), rule.value);
  if (rule.points > 1) text += fmt::format(" for {} points", rule.points);
  if (rule.steps > 0) text += fmt::format("{} {:g} steps", rule.points > 1 ? " and" : " for", rule.steps);
  return text;
}

std::optional<std::string> fault_of(const AlarmRule& rule) {
  if (rule.runs.empty() || rule.runs.size() > kLongestAlarmRuns || has_control(rule.runs))
    return fmt::format("'runs' must be the ID of a run, a pattern such as demo/* or a tag, of at most {} bytes",
                       kLongestAlarmRuns);
  if (!rule.figure.empty() && fault_of_metric(rule.figure))
    return fmt::format("'figure' must be the name of a figure, of one line of at most {} bytes", kLongestMetric);
  if (counts_points(rule) && rule.figure.empty())
    return fmt::format("'figure' is missing: what must not be {}?", name_of(rule.when));
  if (!std::isfinite(rule.value)) return "'value' must be a finite number";
  if (rule.points < 1 || rule.points > kMostPoints) return fmt::format("'points' must be from 1 to {}", kMostPoints);
  if (!(rule.steps >= 0 && rule.steps <= kMostSteps)) return "'steps' must be from 0 to 1e15";
  if (rule.when == When::kSilent && !(rule.minutes >= kLeastMinutes && rule.minutes <= kMostMinutes))
    return fmt::format("'minutes' must be from {:g} to {:g}", kLeastMinutes, kMostMinutes);
  return std::nullopt;
}

bool watches(const AlarmRule& rule, const std::string& run, const std::string& tags) {
  if (rule.runs == run || ("\n" + tags).find("\n" + rule.runs + "\n") != std::string::npos) return true;
  return ::fnmatch(rule.runs.c_str(), run.c_str(), FNM_NOESCAPE) == 0;
}

}  // namespace citylearn
