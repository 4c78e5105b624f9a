// SPDX-License-Identifier: Apache-2.0
#include "core/recording/chunk_store.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace citylearn {
namespace {

template <class Message>
void send_to(const msg::Header& asker, Message& message, const ChunkStore::Send& send) {
  message.header().session() = asker.session();
  message.receiver() = asker.sender();
  Bytes bytes;
  encode(message, bytes);
  send(topic_at(topic_of<Message>(), asker.session().c_str(), asker.sender().c_str()), message.header(), bytes);
}

ObjectKey key_of(const msg::ObjectChunk& chunk) { return {chunk.hash(), chunk.part(), chunk.item()}; }

template <class Chunk>
void send_all(const std::map<std::tuple<std::string, ObjectKey, std::uint32_t>, Chunk>& pieces,
              const msg::ObjectRequest& request, const ChunkStore::Send& send) {
  std::vector<std::uint32_t> chunks = request.chunks();
  for (const std::uint64_t item : request.items()) {
    const ObjectKey key{request.hash(), request.part(), item};
    for (auto piece = pieces.lower_bound({request.server().c_str(), key, 0}); piece != pieces.end(); ++piece) {
      const auto& [server, of, chunk] = piece->first;
      if (server != request.server().c_str() || of != key) break;
      if (!chunks.empty() && std::find(chunks.begin(), chunks.end(), chunk) == chunks.end()) continue;
      Chunk again = piece->second;
      send_to(request.header(), again, send);
    }
    chunks.clear();
  }
}

}  // namespace

bool ChunkStore::keep(const Topic& topic, std::span<const std::byte> bytes) {
  try {
    if (topic.name == topic_of<msg::RouteMapChunk>().name) {
      msg::RouteMapChunk chunk;
      decode(bytes, chunk);
      maps_[{chunk.header().sender().c_str(), key_of(chunk), chunk.chunk()}] = chunk;
      return true;
    }
    if (topic.name != topic_of<msg::ImageChunk>().name) return false;
    msg::ImageChunk chunk;
    decode(bytes, chunk);
    const Piece piece{chunk.header().sender().c_str(), key_of(chunk), chunk.chunk()};
    const std::size_t size = chunk.data().size();
    if (pictures_.try_emplace(piece, std::move(chunk)).second) {
      picture_bytes_ += size;
      by_age_.push_back(piece);
      while (picture_bytes_ > kMaxPictureBytes) forget_oldest();
    }
    return true;
  } catch (const Error&) {
    return false;
  }
}

void ChunkStore::forget_oldest() {
  const auto oldest = pictures_.find(by_age_.front());
  picture_bytes_ -= oldest->second.data().size();
  pictures_.erase(oldest);
  by_age_.pop_front();
}

void ChunkStore::answer(const Topic& topic, const msg::ObjectRequest& request, const Send& send) {
  if (topic.name == topic_of<msg::RouteMapRequest>().name)
    send_all(maps_, request, send);
  else
    send_all(pictures_, request, send);
}

}  // namespace citylearn
