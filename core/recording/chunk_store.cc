// SPDX-License-Identifier: Apache-2.0
#include "core/recording/chunk_store.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace citylearn {

bool ChunkStore::keep(const Topic& topic, std::span<const std::byte> bytes) {
  const bool picture = topic.name == topic_of<msg::ImageChunk>().name;
  if (!picture && topic.name != topic_of<msg::RouteMapChunk>().name) return false;
  msg::ImageChunk chunk;  // of a map, too: both have one type
  try {
    decode(bytes, chunk);
  } catch (const Error&) {
    return false;
  }
  const ObjectKey key{chunk.hash(), chunk.part(), chunk.item()};
  const Piece piece{topic.name, chunk.header().sender().c_str(), key, chunk.chunk()};
  const std::size_t size = chunk.data().size();
  if (!chunks_.try_emplace(piece, std::move(chunk)).second || !picture) return true;
  picture_bytes_ += size;
  by_age_.push_back(piece);
  while (picture_bytes_ > kMaxPictureBytes) forget_oldest();
  return true;
}

void ChunkStore::forget_oldest() {
  const auto oldest = chunks_.find(by_age_.front());
  picture_bytes_ -= oldest->second.data().size();
  chunks_.erase(oldest);
  by_age_.pop_front();
}

void ChunkStore::answer(const Topic& asked, const msg::ObjectRequest& request, const Send& send) {
  const Topic& topic = asked.name == topic_of<msg::RouteMapRequest>().name ? topic_of<msg::RouteMapChunk>()
                                                                           : topic_of<msg::ImageChunk>();
  const Topic to = topic_at(topic, request.header().session().c_str(), request.header().sender().c_str());
  std::vector<std::uint32_t> chunks = request.chunks();
  for (const std::uint64_t item : request.items()) {
    const ObjectKey key{request.hash(), request.part(), item};
    const Piece first{topic.name, request.server().c_str(), key, 0},
        last{topic.name, request.server().c_str(), key, ~0u};
    for (auto piece = chunks_.lower_bound(first); piece != chunks_.end() && piece->first <= last; ++piece) {
      msg::ImageChunk chunk = piece->second;
      if (!chunks.empty() && std::find(chunks.begin(), chunks.end(), chunk.chunk()) == chunks.end()) continue;
      chunk.header().session() = request.header().session();
      chunk.receiver() = request.header().sender();
      Bytes bytes;
      encode(chunk, bytes);
      send(to, chunk.header(), bytes);
    }
    chunks.clear();
  }
}

}  // namespace citylearn
