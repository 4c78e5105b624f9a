// SPDX-License-Identifier: Apache-2.0
#include "core/recording/chunk_store.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace citylearn {

bool ChunkStore::keep(const Topic& topic, std::span<const std::byte> bytes) {
  if (topic.name != topic_.name) return false;
  msg::ImageChunk chunk;
  try {
    decode(bytes, chunk);
  } catch (const Error&) {
    return false;
  }
  const Piece piece{chunk.header().sender().c_str(), {chunk.hash(), chunk.part(), chunk.item()}, chunk.chunk()};
  const std::size_t size = chunk.data().size();
  if (!chunks_.try_emplace(piece, std::move(chunk)).second) return true;
  bytes_ += size;
  by_age_.push_back(piece);
  for (; bytes_ > kMaxBytes; by_age_.pop_front()) bytes_ -= chunks_.extract(by_age_.front()).mapped().data().size();
  return true;
}

void ChunkStore::answer(const msg::ObjectRequest& request, const Send& send) const {
  const Topic to = topic_at(topic_, request.header().session().c_str(), request.header().sender().c_str());
  std::vector<std::uint32_t> indices = request.chunks();
  Bytes bytes;
  for (const std::uint64_t item : request.items()) {
    const ObjectKey key{request.hash(), request.part(), item};
    const std::string server = request.server().c_str();
    const auto end = chunks_.upper_bound({server, key, ~0u});
    for (auto piece = chunks_.lower_bound({server, key, 0}); piece != end; ++piece) {
      msg::ImageChunk chunk = piece->second;
      if (!indices.empty() && std::find(indices.begin(), indices.end(), chunk.chunk()) == indices.end()) continue;
      chunk.header().session() = request.header().session();
      chunk.receiver() = request.header().sender();
      encode(chunk, bytes);
      send(to, chunk, bytes);
    }
    indices.clear();
  }
}

}  // namespace citylearn
