// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "dashboard/store/rows.h"
#include "dashboard/store/store.h"

namespace citylearn {

/// Keeps in a store what replays of a run show once its env_services are gone: the maps of its traversals, and
/// pictures of places that are spread evenly over its route. Only what a run in the store shows is kept; the store
/// removes it with the last such run. Each map and picture is stored once, however many runs show it. Each is on the
/// disk as a whole or not at all. All methods throw Error when the store cannot be read or written.
class RouteStore {
 public:
  struct Options {
    std::size_t run_bytes = std::size_t{8} << 20;        ///< of pictures, of all traversals of a run
    std::size_t traversal_bytes = std::size_t{2} << 20;  ///< of pictures, of one traversal of a run
    std::size_t places = 128;                            ///< of a run's route on one traversal
    std::size_t map_frames = std::size_t{1} << 20;       ///< of a map, 20 bytes each; none is kept of a longer one
  };
  /// `store` must outlive it.
  RouteStore(Store& store, const Options& options) : store_(store), options_(options) {}
  explicit RouteStore(Store& store) : RouteStore(store, Options()) {}

  /// The part of a traversal that a run's agents are on.
  struct Part {
    std::int64_t run = 0;  ///< row of the newest run with this part
    std::uint32_t first = 0, last = 0;
  };
  /// The map and pictures of a traversal that are still to be stored.
  struct Gaps {
    bool map = false;
    struct Place {
      Part part;
      std::uint32_t frame = 0;
    };
    std::vector<Place> places;  ///< ordered such that the first ones alone are spread evenly, too
  };
  /// Returns what is missing of a traversal that some run shows and the budgets allow.
  Gaps gaps(const TraversalRow& traversal);

  /// Keeps a map. Returns false when no run shows the traversal (any more).
  bool keep(std::uint64_t hash, const RouteMap& map);
  /// Keeps the picture of a place. Returns false when no run shows the traversal (any more), or a budget is used up.
  bool keep(std::uint64_t hash, const Gaps::Place& place, const PictureFile& picture);

 private:
  Store& store_;
  const Options options_;
};

/// Returns `most` frames at most of `first`..`last`, spread evenly, in an order of which each beginning is spread, too.
std::vector<std::uint32_t> spread_frames(std::uint32_t first, std::uint32_t last, std::size_t most);

/// Removes maps and pictures that no run shows. Belongs into the transaction that removes a run.
void remove_unused_routes(SQLite::Database& database);

}  // namespace citylearn
