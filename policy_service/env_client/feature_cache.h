// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/wire/node.h"
#include "core/wire/transfer.h"

namespace citylearn {

/// Features of successive frames of a traversal, once they are complete.
struct RouteFeatures {
  explicit RouteFeatures(const Transfer::What& what) : transfer(what) {}

  bool complete() const { return transfer.complete(); }
  /// Returns the D features of a frame (index on the traversal), or null when it is not among these.
  const float* at(std::uint32_t frame) const {
    const Transfer::What& what = transfer.what();
    if (frame - what.first >= what.count) return nullptr;
    return transfer.features.data() + std::size_t{frame - what.first} * what.dimension;
  }
  std::uint32_t dimension() const { return transfer.what().dimension; }

  Transfer transfer;
  std::string encoder;         ///< that made them from images; else empty
  Clock::time_point progress;  ///< when the last chunk arrived, or no service was there to ask
};

/// Fetches the features of routes, each once per (traversal hash, D, encoder), and shares them. It keeps what is in
/// use, however large, and at most `kept` bytes of the rest. Used by one thread.
class FeatureCache {
 public:
  explicit FeatureCache(Node& node, std::size_t kept = std::size_t{256} << 20) : node_(node), kept_(kept) {}

  /// Returns the features of frames first .. first + count - 1, complete once their chunks have arrived. Throws Error
  /// when the traversal has no features, or the frames do not lie on it.
  std::shared_ptr<RouteFeatures> want(const msg::TraversalInfo& info, std::uint32_t first, std::uint32_t count);
  /// Asks an env_service (or the encoder_service behind it) for what is missing, when it is time to.
  void ask(RouteFeatures& route, const std::string& environment);
  /// Returns false when a chunk that is needed is damaged or its sender is not `trusted`; it is then not used.
  bool take(const msg::TraversalChunk& chunk, bool trusted = true);

 private:
  void forget();

  Node& node_;
  std::size_t kept_;
  std::vector<std::shared_ptr<RouteFeatures>> routes_;  ///< the one wanted last stands last
  msg::TraversalRequest request_;
};

}  // namespace citylearn
