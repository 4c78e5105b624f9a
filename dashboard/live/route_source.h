// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "dashboard/live/picture_cache.h"
#include "dashboard/store/rows.h"

namespace citylearn {

/// Maps and pictures of routes of living env_services. Its methods belong to the thread of the node and never wait.
class RouteSource {
 public:
  virtual ~RouteSource() = default;
  /// Returns the traversals that living env_services host, one of each hash, by hash.
  virtual std::vector<TraversalRow> hosted() = 0;
  /// Returns a map, or null and sees to it that it comes.
  virtual std::shared_ptr<const RouteMap> route_map(std::uint64_t hash) = 0;

  struct SparePicture {
    std::shared_ptr<const PictureFile> picture;  ///< null: it is not here
    bool coming = false;                         ///< it is being fetched
  };
  /// Returns a picture that nobody waits for. Fetches it only while no other one is fetched, at a low rate.
  virtual SparePicture spare_picture(const PictureKey& key) = 0;
};

}  // namespace citylearn
