// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "core/exchange/object_fetch.h"
#include "core/exchange/timing.h"
#include "core/task/live.h"
#include "core/util/text.h"
#include "core/wire/transfer.h"
#include "encoder_service/pipeline/live_features.h"
#include "encoder_service/pipeline/traversal_work.h"

namespace citylearn {

/// A frame's image as it came over the wire.
struct FetchedImage {
  int frame = 0;
  std::string name;  ///< for messages
  Bytes file;        ///< empty when there is none; `name` then says why
};

/// The frames of one traversal, or of several of equal contents, on their way from images to features.
struct EncodedTraversal {
  explicit EncodedTraversal(const msg::TraversalInfo& info)
      : hash(info.hash()),
        frames(static_cast<int>(info.frames())),
        is_live(citylearn::is_live(info)),
        images({.hash = hash, .retry = kObjectRetry, .max_bytes = msg::MAX_IMAGE + 1024}),
        positions({hash, info.frames(), 0}) {}

  /// "12 s", expected until its last frame is encoded; empty while no frame was.
  std::string time_left(Clock::time_point now) const;
  /// d; once ready.
  int dimension() const { return live ? live->dimension() : static_cast<int>(features.rows()); }
  /// Returns the d features of a frame; null when there are none.
  const float* find(std::uint32_t frame) const {
    if (live) return live->find(static_cast<int>(frame));
    return frame < static_cast<std::uint32_t>(features.cols()) ? features.col(frame).data() : nullptr;
  }

  /// "summer", or "summer, winter" of equal contents; for messages.
  std::string name() const { return joined(names); }

  std::set<std::string> names;  // of the traversals that have these frames
  std::uint64_t hash;
  int frames;
  bool is_live;        // a robot's: pictures are encoded when observations name them
  ObjectFetch images;  // by frame
  Transfer positions;

  std::unique_ptr<TraversalWork> work;
  Clock::time_point since{}, next_progress{};
  int in_background = 0;              // images given to the encoding thread
  std::size_t bytes = 0;              // of images that have come and are not encoded yet
  std::vector<FetchedImage> waiting;  // for a full batch
  bool reducing = false;
  std::string fault;                   // why it is refused
  Eigen::MatrixXf features;            // d x F once ready, unless it is live
  std::unique_ptr<LiveFeatures> live;  // once ready, if it is
  std::set<int> asked;                 // live frames whose features are being made
  bool ready = false;
};

}  // namespace citylearn
