// SPDX-License-Identifier: Apache-2.0
#include "core/recording/chunk_store.h"

#include <utility>

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

}  // namespace

bool ChunkStore::keep(const Topic& topic, std::span<const std::byte> bytes) {
  try {
    if (topic.name == topic_of<msg::MapChunk>().name) {
      msg::MapChunk chunk;
      decode(bytes, chunk);
      maps_[{chunk.header().sender().c_str(), chunk.hash(), chunk.first()}] = chunk;
      return true;
    }
    if (topic.name != topic_of<msg::ImageChunk>().name) return false;
    msg::ImageChunk chunk;
    decode(bytes, chunk);
    const Piece key{chunk.header().sender().c_str(), chunk.hash(), chunk.frame(), chunk.chunk()};
    const std::size_t size = chunk.data().size();
    if (pictures_.try_emplace(key, std::move(chunk)).second) {
      picture_bytes_ += size;
      by_age_.push_back(key);
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

void ChunkStore::answer(const msg::MapRequest& request, const Send& send) {
  const auto map = maps_.find({request.environment().c_str(), request.hash(), request.first()});
  if (map != maps_.end()) send_to(request.header(), map->second, send);
}

void ChunkStore::answer(const msg::ImageRequest& request, const Send& send) {
  std::uint32_t first = request.first_chunk();
  for (const std::uint32_t frame : request.frames()) {
    const std::string environment = request.environment().c_str();
    for (auto piece = pictures_.lower_bound({environment, request.hash(), frame, first});
         piece != pictures_.end() && piece->first < Piece{environment, request.hash(), frame + 1, 0}; ++piece)
      send_to(request.header(), piece->second, send);
    first = 0;
  }
}

}  // namespace citylearn
