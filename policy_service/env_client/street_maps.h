// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "core/exchange/object_fetch.h"
#include "core/task/state_map.h"
#include "core/wire/node.h"

namespace citylearn {

/// Fetches the street maps that env_services announced, each from one of them, and derives their states, which all
/// env_services of a city with the same rule share. Keeps those in use and a few others. Used by one thread.
class StreetMaps {
 public:
  static constexpr std::size_t kMaxMaps = 16;  ///< in use at once

  /// Asks in vain for `patience` before it gives up.
  StreetMaps(Node& node, std::chrono::milliseconds patience);

  /// Returns the states that an env_service announced, or asks it for its map when it is time to, and returns null.
  /// Throws Error when it does not send it, sends a wrong one several times, or more than kMaxMaps are in use.
  std::shared_ptr<const StateMap> find_or_ask(const msg::TraversalInfo& info);
  /// Takes a chunk of the env_service that announced this, or of a participant that says so. Returns whether it is
  /// whole, and its map the one announced.
  bool take(const msg::TraversalInfo& info, const msg::StreetsChunk& chunk);
  /// Asks an env_service no more.
  void forget(const std::string& id) { fetches_.erase(id); }

 private:
  using Key = std::pair<std::uint64_t, msg::StateRule>;
  struct Fetch {
    Key key;
    ObjectFetch object;
    std::string problem;  ///< of the map that came last
  };
  std::shared_ptr<const StateMap> read(const msg::TraversalInfo& info, const Bytes& bytes) const;

  Node& node_;
  int tries_;
  std::map<Key, std::shared_ptr<const StateMap>> maps_;
  std::map<std::string, Fetch> fetches_;  ///< by id of the env_service
  msg::StreetsRequest request_;
};

/// Returns what is wrong with the counts that an env_service on streets announced; empty when nothing is.
std::string streets_misfit(const msg::TraversalInfo& info);

}  // namespace citylearn
