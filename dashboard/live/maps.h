// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/exchange/object_fetch.h"
#include "core/wire/node.h"
#include "dashboard/store/rows.h"

namespace citylearn {

/// Fetches maps of traversals from env_services on request, and caches them. Used by one thread at a time.
class Maps {
 public:
  static constexpr std::size_t kMaxMaps = 32;         ///< kept
  static constexpr std::size_t kMaxFrames = 4 << 20;  ///< of all together

  explicit Maps(Node& node) : node_(node) {}
  /// Returns null while it is not complete.
  std::shared_ptr<const RouteMap> find(std::uint64_t hash);
  /// Starts to fetch a map unless it is here or under way.
  void fetch(std::uint64_t hash, const std::string& session, const std::string& environment);
  bool fetching(std::uint64_t hash) const { return fetches_.contains(hash); }
  /// Takes chunks that arrived and requests what is due.
  void poll(Clock::time_point now);
  Clock::time_point due() const;

 private:
  struct Fetch {
    std::string session, environment;
    ObjectFetch object;
  };
  void on_message(const msg::RouteMapChunk& chunk, Clock::time_point now);
  void keep(std::uint64_t hash, const msg::RouteMap& sent);

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
};

}  // namespace citylearn
