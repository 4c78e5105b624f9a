// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <tuple>

#include "core/exchange/object.h"
#include "core/wire/messages.h"

namespace citylearn {

/// Keeps recorded objects of one kind, maps or pictures, and answers requests for them in place of the recorded
/// env_services. It says nothing of an object that it lacks, as that may come later in the recording. Used by one
/// thread.
class ChunkStore {
 public:
  static constexpr std::size_t kMaxBytes = 256u << 20;  ///< beyond them the oldest chunks are forgotten

  /// `topic`, on which the chunks were sent, must outlive it.
  explicit ChunkStore(const Topic& topic) : topic_(topic) {}

  /// Keeps a chunk. Returns false for other topics, and for bytes that cannot be decoded.
  bool keep(const Topic& topic, std::span<const std::byte> bytes);

  /// Called for each chunk that answers a request, with the recorded sender and the service that asks now.
  using Send = std::function<void(const Topic& topic, const msg::ObjectChunk& chunk, const Bytes& bytes)>;
  void answer(const msg::ObjectRequest& request, const Send& send) const;

 private:
  using Piece = std::tuple<std::string, ObjectKey, std::uint32_t>;  // env_service, key, chunk

  const Topic& topic_;
  std::map<Piece, msg::ImageChunk> chunks_;  // of maps, too: all kinds have one type
  std::deque<Piece> by_age_;
  std::size_t bytes_ = 0;
};

}  // namespace citylearn
