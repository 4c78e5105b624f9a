// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace citylearn {

/// What is known of a run, by name: "learner.clip" -> "0.2". Names of nested JSON are joined by dots.
using RunFacts = std::map<std::string, std::string>;

/// Adds the leaves of a JSON object to `facts`; lists are leaves. What is not JSON adds nothing.
void add_json_leaves(RunFacts& facts, const std::string& object, const std::string& prefix = "");

struct ComparedFact {
  std::string key;
  std::vector<std::optional<std::string>> values;  ///< one a run; nothing: the run has none
  bool differs = false;
};

/// Returns all facts of several runs, by name. A run of which nothing is known differs in nothing.
std::vector<ComparedFact> compare(std::span<const RunFacts> runs);

}  // namespace citylearn
