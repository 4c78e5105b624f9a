// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/wire/node.h"
#include "core/wire/transfer.h"

namespace citylearn {

/// Features of a run of a traversal's frames, once they are complete.
struct RouteFeatures {
  explicit RouteFeatures(const Transfer::What& what) : transfer(what) {}

  bool complete() const { return transfer.complete(); }
  /// Of a frame (index on the traversal): D floats; null when it is beside the run.
  const float* at(std::uint32_t frame) const {
    const Transfer::What& what = transfer.what();
    if (frame - what.first >= what.count) return nullptr;
    return transfer.features.data() + std::size_t{frame - what.first} * what.dimension;
  }
  std::uint32_t dimension() const { return transfer.what().dimension; }

  Transfer transfer;
  std::string encoder;      ///< what made them of pictures; else empty
  Clock::time_point moved;  ///< when the last chunk came, or there was nobody to ask
};

/// Features of routes, each fetched once per (traversal hash, D, encoder) and shared by all that need it. It keeps what
/// somebody holds, however large, and at most `kept` bytes beside that. Used by one thread.
class FeatureCache {
 public:
  explicit FeatureCache(Node& node, std::size_t kept = std::size_t{256} << 20) : node_(node), kept_(kept) {}

  /// Frames first .. first + count - 1 of the traversal announced by `info`; complete only once its chunks have come.
  /// Throws Error when it has no features, or the frames do not lie on it.
  std::shared_ptr<RouteFeatures> want(const msg::TraversalInfo& info, std::uint32_t first, std::uint32_t count);
  /// Asks an env_service (or the encoder_service that serves it) for what is missing, when it is time to.
  void ask(RouteFeatures& route, const std::string& environment);
  /// False when it is of use and damaged, or not `believed` to come from who has the features: then it is not used.
  bool take(const msg::TraversalChunk& chunk, bool believed = true);

 private:
  void forget();

  Node& node_;
  std::size_t kept_;
  std::vector<std::shared_ptr<RouteFeatures>> routes_;  ///< the one wanted last is the last
  msg::TraversalRequest request_;
};

}  // namespace citylearn
