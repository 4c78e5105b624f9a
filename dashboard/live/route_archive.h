// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <optional>

#include "core/exchange/timing.h"
#include "core/util/types.h"
#include "dashboard/live/picture_shrink.h"
#include "dashboard/live/route_source.h"
#include "dashboard/store/route_store.h"

namespace citylearn {

/// Stores maps and small pictures of the traversals that runs use, while env_services host them, so that the Route page
/// of a run is whole when they are gone. It takes the hosted traversals in turn and fetches one picture at a time, so
/// that env_services hardly notice. Belongs to the thread of the node.
class RouteArchive {
 public:
  struct Options {
    PictureLimits limits{320, std::size_t{16} << 10};      ///< of a stored picture
    std::chrono::milliseconds between = kPictureInterval;  ///< two pictures, at least
    std::chrono::milliseconds poll_after{50};              ///< while a picture is on its way
    std::chrono::milliseconds look_again{2000};            ///< when nothing was missing
    std::chrono::milliseconds retry_after{60000};  ///< of a picture that did not come; of the store when it failed
  };
  /// `store` and `source` must outlive it.
  RouteArchive(RouteStore store, RouteSource& source, const Options& options)
      : store_(store), source_(source), options_(options) {}
  RouteArchive(RouteStore store, RouteSource& source) : RouteArchive(store, source, Options()) {}

  /// Does what is due. Call it at due(), or earlier.
  void poll();
  Clock::time_point due() const { return due_; }

 private:
  struct Request {
    PictureKey key;
    RouteStore::Gaps::Place place;
    Clock::time_point patience;  // until which it may be refused
    bool coming = false;
  };
  void take_next();
  bool store_gap(const TraversalRow& traversal);
  void take_picture();

  RouteStore store_;
  RouteSource& source_;
  const Options options_;
  std::uint64_t last_ = 0;    // hash of the traversal that was looked at last
  std::size_t complete_ = 0;  // traversals in turn of which nothing was missing
  std::optional<Request> request_;
  std::map<PictureKey, Clock::time_point> failed_;  // when to ask again
  Clock::time_point due_{};
};

}  // namespace citylearn
