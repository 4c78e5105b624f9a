// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>

#include "core/exchange/object_fetch.h"
#include "core/wire/node.h"
#include "dashboard/store/rows.h"

namespace citylearn {

/// Returns what an env_service announces.
TraversalRow row_of(const msg::TraversalInfo& info);

/// Fetches maps of traversals from env_services on request, and caches them. Used by one thread at a time.
class Maps {
 public:
  static constexpr std::size_t kMaxMaps = 32;         ///< kept
  static constexpr std::size_t kMaxFrames = 4 << 20;  ///< of all together

  explicit Maps(Node& node) : node_(node) {}
  /// Returns null while it is not complete.
  std::shared_ptr<const RouteMap> find(std::uint64_t hash);
  /// Starts to fetch a map unless it is here or under way.
  void fetch(const TraversalRow& traversal, const std::string& session);
  bool fetching(std::uint64_t hash) const { return fetches_.contains(hash); }
  /// Takes chunks that arrived and requests what is due.
  void poll(Clock::time_point now);
  Clock::time_point due() const;

 private:
  struct Fetch {
    std::string session;
    TraversalRow traversal;
    ObjectFetch object;  ///< a RouteMap, or Streets
    bool streets() const { return traversal.rule != StateRule::kLine; }
  };
  template <class Chunk>
  void take(Chunk& chunk, bool streets, Clock::time_point now);
  void keep(const TraversalRow& traversal, const Bytes& object);

  Node& node_;
  std::map<std::uint64_t, Fetch> fetches_;
  struct Kept {
    std::shared_ptr<const RouteMap> map;
    std::uint64_t used = 0;
  };
  std::map<std::uint64_t, Kept> maps_;
  std::uint64_t uses_ = 0;
  msg::RouteMapRequest request_;
  msg::RouteMapChunk chunk_;
  msg::StreetsRequest streets_request_;
  msg::StreetsChunk streets_chunk_;
};

}  // namespace citylearn
