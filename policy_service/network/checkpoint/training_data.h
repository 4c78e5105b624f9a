// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace citylearn {

/// The contents that the env_services of one traversal must share, so that an agent sees the same on all of them.
struct TraversalContents {
  std::string traversal;
  std::uint64_t hash = 0;
  std::uint32_t feature_dimension = 0;
  std::optional<std::string> encoder = {};  ///< as in TraversalInfo; unset: unknown
  std::string dataset = {};                 ///< likewise; empty: unknown
  std::uint32_t frames = 0;                 ///< likewise; 0: unknown
  std::uint64_t streets_hash = 0;           ///< likewise; 0: a line

  bool operator==(const TraversalContents&) const = default;
};

/// Returns how the features of contents are of another kind than those of `whose`; empty when they are not.
std::string features_misfit(const TraversalContents& contents, const TraversalContents& others,
                            const std::string& whose);

/// Returns how contents differ from those of `whose`; empty when they do not.
std::string contents_misfit(const TraversalContents& contents, const TraversalContents& others,
                            const std::string& whose);

/// What an agent learned from. Checkpoints, exported agents and manifests have it.
struct TrainingData {
  std::vector<TraversalContents> traversals;  ///< in the order of --train; empty: unknown
  std::map<std::string, std::string> source;  ///< --source: options by name, without dashes; empty: unknown

  bool known() const { return !traversals.empty(); }
  std::vector<std::string> names() const;
  /// Returns how contents do not fit an agent that learned from this; empty when they do, or nothing is known. A
  /// traversal learned from must be the same, others, and those of other streets, must have features of the same kind.
  std::string misfit(const TraversalContents& contents) const;
  /// Returns what to do about a misfit of an env_service on `traversal`.
  std::string remedy(const std::string& traversal) const;

  /// Returns JSON; parse() reads it, or a manifest, and throws Error naming `where`. Empty text: nothing is known.
  std::string text() const;
  static TrainingData parse(const std::string& text, const std::string& where);
};

}  // namespace citylearn
