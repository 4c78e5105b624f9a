// SPDX-License-Identifier: Apache-2.0
#include "core/exchange/object.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "core/util/sha256.h"

namespace citylearn {
namespace {

constexpr std::uint32_t kAllChunks = std::numeric_limits<std::uint32_t>::max();

}  // namespace

std::uint64_t object_checksum(std::span<const std::byte> bytes) {
  Sha256 hash;
  hash.add(bytes.data(), bytes.size());
  return hash.first_8_bytes();
}

ObjectBytes::ObjectBytes(const ObjectKey& of, Bytes all)
    : key(of), bytes(std::move(all)), checksum(object_checksum(bytes)) {}

void ObjectBytes::fill(std::uint32_t chunk, msg::ObjectChunk& message) const {
  message.hash() = key.hash;
  message.part() = key.part;
  message.item() = key.item;
  message.total_bytes() = static_cast<std::uint32_t>(bytes.size());
  message.checksum() = checksum;
  message.chunk() = chunk;
  const auto data = chunk_of(std::span<const std::byte>(bytes), chunk);
  message.data().resize(data.size());
  if (!data.empty()) std::memcpy(message.data().data(), data.data(), data.size());
}

void ObjectServer::note(const msg::ObjectRequest& request) {
  std::erase_if(sent_, [&, now = Clock::now()](const auto& sent) { return now > sent.second.at + crossing_; });
  const std::string service = request.header().sender().c_str();
  Order& order = orders_[service];
  std::vector<std::uint32_t> chunks = request.chunks();
  bool more = false;
  for (const std::uint64_t item : request.items()) {
    if (order.objects.size() == msg::MAX_ITEMS_ASKED) break;
    Wanted wanted{{request.hash(), request.part(), item}, std::exchange(chunks, {}), 0};
    const bool some = !wanted.chunks.empty();
    if (const auto sent = sent_.find({service, wanted.key}); sent != sent_.end())
      wanted.first = sent->second.next_chunk;
    std::erase_if(wanted.chunks, [&](std::uint32_t chunk) { return chunk < wanted.first; });
    if (wanted.first == kAllChunks || (some && wanted.chunks.empty()) ||
        std::any_of(order.objects.begin(), order.objects.end(),
                    [&](const Wanted& other) { return other.key == wanted.key; }))
      continue;
    order.objects.push_back(std::move(wanted));
    more = true;
  }
  if (more) order.most_chunks += msg::MAX_CHUNKS_ASKED;
}

bool ObjectServer::send(msg::ObjectChunk& chunk, const std::function<void()>& publish) {
  for (auto& [service, order] : orders_)
    if (!order.objects.empty()) send_first(service, order, chunk, publish);
  std::erase_if(orders_, [](const auto& order) { return order.second.objects.empty(); });
  return !orders_.empty();
}

/// Sends the first object of an order, or as many of its chunks as are expected; the service then asks for the rest.
void ObjectServer::send_first(const std::string& service, Order& order, msg::ObjectChunk& chunk,
                              const std::function<void()>& publish) {
  Wanted wanted = std::move(order.objects.front());
  order.objects.pop_front();
  if (!found_ || found_->key != wanted.key) found_ = find_(wanted.key);
  const ObjectBytes& object = found_ ? *found_ : ObjectBytes(wanted.key, {});
  const std::uint32_t chunks = object.chunks();
  if (wanted.chunks.empty())
    for (std::uint32_t index = wanted.first; index < chunks; ++index) wanted.chunks.push_back(index);
  rejected_ += std::erase_if(wanted.chunks, [chunks](std::uint32_t index) { return index >= chunks; });
  if (wanted.chunks.empty()) return;
  const bool cut = wanted.chunks.size() > order.most_chunks;
  if (cut) wanted.chunks.resize(order.most_chunks);
  chunk.receiver() = service.c_str();
  for (const std::uint32_t index : wanted.chunks) {
    object.fill(index, chunk);
    publish();
  }
  const std::uint32_t end = wanted.chunks.back() + 1;
  sent_[{service, wanted.key}] = {Clock::now(), end == chunks ? kAllChunks : end};
  order.most_chunks -= wanted.chunks.size();
  if (cut || order.most_chunks == 0) order.objects.clear();
}

}  // namespace citylearn
