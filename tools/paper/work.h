// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/vpr/descriptors.h"

namespace citylearn::paper {

using Json = nlohmann::json;

/// Ctrl-C or SIGTERM has come: what is complete is kept, what is not is left.
using vpr::Stopped;

/// Throws Error that names the option it is for.
void make_folder(const std::string& folder, const std::string& option);

/// Null where there is none: NaN, infinite.
Json number(double value);

/// One piece of work, whose outcome depends on its spec alone.
struct Unit {
  std::string name;               ///< for people: "features hog-64, seed 3"
  Json spec;                      ///< all that the outcome depends on; with `kVersion` it names the outcome's file
  double seconds = 1;             ///< that it takes, guessed, for the time left
  std::function<Json()> compute;  ///< throws Error, Stopped (asked of stop_requested() now and then)
};

/// `outcome` without what the machine decides, not the seed: all members named "seconds" or "bytes", at whatever depth.
Json repeatable(const Json& outcome);

/// Does units of work, each once: outcomes are kept in a folder, written whole, and found again by the next run. Used
/// by one thread.
class Work {
 public:
  /// Raised when the same spec gives another outcome than before.
  static constexpr int kVersion = 3;

  /// Creates the folder. Throws Error.
  explicit Work(std::string folder);

  /// Registers a unit; the same spec twice is one unit.
  void add(Unit unit);
  /// Does what is not there yet, in the order of add(), with a line of progress and time left. Units that throw Error
  /// are told and left out; the others go on. False when one failed. Throws Stopped.
  bool run();
  /// Outcome of a unit; null when there is none (it failed).
  const Json& outcome(const Json& spec) const;

  int units() const { return static_cast<int>(units_.size()); }

  /// All outcomes as they are again with the same seeds, a line a unit, for `diff`: [{"name", "spec", "outcome"}, ...].
  std::string results() const;
  /// What each unit took, in this run or an earlier one: [{"name", "seconds"}], null where it failed.
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
  std::map<std::string, Done> outcomes_;  ///< by path
};

}  // namespace citylearn::paper
