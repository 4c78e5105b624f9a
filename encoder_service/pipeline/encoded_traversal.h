// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "core/wire/transfer.h"
#include "encoder_service/pipeline/image_fetch.h"
#include "encoder_service/pipeline/traversal_work.h"

namespace citylearn {

/// One traversal on its way from images to features.
struct EncodedTraversal {
  EncodedTraversal(Node& node, const msg::TraversalInfo& info)
      : name(info.traversal().c_str()),
        hash(info.hash()),
        frames(static_cast<int>(info.frames())),
        images(node, hash, frames),
        positions({hash, info.frames(), 0}) {}

  /// "12 s", expected until its last frame is encoded; empty while no frame was.
  std::string time_left(Clock::time_point now) const;

  std::string name;
  std::uint64_t hash;
  int frames;
  ImageFetch images;
  Transfer positions;

  std::unique_ptr<TraversalWork> work;
  Clock::time_point since{}, next_progress{};
  int in_background = 0;              // images given to the encoding thread
  std::size_t bytes = 0;              // of images that have come and are not encoded yet
  std::vector<FetchedImage> waiting;  // for a full batch
  bool reducing = false;
  std::string fault;         // why it is refused
  Eigen::MatrixXf features;  // d x F once ready
  bool ready = false;
};

}  // namespace citylearn
