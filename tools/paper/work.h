// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/lab/descriptors.h"

namespace citylearn::paper {

using Json = nlohmann::json;

/// Ctrl-C or SIGTERM arrived: complete units are kept, the rest is abandoned.
using lab::Stopped;
/// Throws Stopped when one of them has arrived.
void throw_if_stopped();

/// Returns null for NaN and infinity.
Json number(double value);

/// One piece of work, whose outcome depends on its spec alone.
struct Unit {
  std::string name;               ///< for logs: "features hog-64, seed 3"
  Json spec;                      ///< all that the outcome depends on; with `kVersion` it names the outcome's file
  double seconds = 1;             ///< estimated duration, for the time left
  std::function<Json()> compute;  ///< throws Error, and Stopped soon after stop_requested()
};

/// `outcome` without what depends on the machine: all members named "seconds", at whatever depth.
Json repeatable(const Json& outcome);
/// Returns only those members, in their objects; null when there are none.
Json measured(const Json& outcome);

/// Computes units of work, each once: it stores outcomes in a folder, where the next run finds them. Not thread-safe.
class Work {
 public:
  /// Raise it when the same spec gives another outcome than before.
  static constexpr int kVersion = 7;

  /// Creates the folder. Throws Error.
  explicit Work(std::string folder);

  /// Registers a unit and returns its number, counted from 0; the same spec twice is one unit.
  int add(Unit unit);
  /// Does the units that have no outcome yet, in the order of add(), with a line of progress and time left. Units that
  /// throw Error are logged and left out; the others go on. False when one failed. Throws Stopped.
  bool run();
  /// Returns the outcome of a unit; null when there is none (it failed).
  const Json& outcome(int unit) const;

  int units() const { return static_cast<int>(units_.size()); }

  /// Returns all outcomes without what depends on the machine, one line a unit: [{"name", "spec", "outcome"}, ...].
  std::string results() const;
  /// Returns what measured() leaves of each outcome, in the same order.
  Json measurements() const;
  /// Returns the duration of each unit, in this run or an earlier one: [{"name", "seconds"}], null where it failed.
  Json times() const;

 private:
  struct Done {
    Json outcome;  ///< null: there is none
    double seconds = 0;
  };
  static Done read(const std::string& path, const Json& spec);
  std::string path_of(const Json& spec) const;

  std::string folder_;
  std::vector<Unit> units_;
  std::vector<Done> done_;              ///< by unit
  std::map<std::string, int> numbers_;  ///< of units, by path
};

}  // namespace citylearn::paper
