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

/// Keeps recorded maps and pictures, and answers requests for them in place of the recorded env_services: sends them to
/// the services that ask now. Used by one thread.
class ChunkStore {
 public:
  static constexpr std::size_t kMaxPictureBytes = 256u << 20;  ///< beyond them the oldest pictures are forgotten

  /// Keeps a RouteMapChunk or an ImageChunk. Returns false for other topics, and for bytes that cannot be decoded.
  bool keep(const Topic& topic, std::span<const std::byte> bytes);

  /// Called with the recorded sender and the bytes that answer, on this topic.
  using Send = std::function<void(const Topic& topic, const msg::Header& sender, const Bytes& bytes)>;
  /// Answers a request, which was `asked` on the topic of requests for maps or on that for pictures.
  void answer(const Topic& asked, const msg::ObjectRequest& request, const Send& send);

 private:
  using Piece = std::tuple<std::string, std::string, ObjectKey, std::uint32_t>;  // topic, env_service, key, chunk
  void forget_oldest();

  std::map<Piece, msg::ImageChunk> chunks_;
  std::deque<Piece> by_age_;  ///< of pictures
  std::size_t picture_bytes_ = 0;
};

}  // namespace citylearn
