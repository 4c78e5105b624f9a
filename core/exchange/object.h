// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <compare>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/exchange/blob.h"
#include "core/exchange/timing.h"
#include "core/util/types.h"
#include "idl/object.h"

// Objects (idl/object.idl): bytes with a key, which are asked for and come in chunks. The classes below know no wire:
// their users publish what they fill in, and encode and decode the bytes (core/wire/messages.h).
namespace citylearn {

/// Names an object for good: equal keys, equal bytes. Each kind of object has its own meaning for the fields.
struct ObjectKey {
  std::uint64_t hash = 0;
  std::uint32_t part = 0;
  std::uint64_t item = 0;
  auto operator<=>(const ObjectKey&) const = default;
};

/// Returns the checksum of an object's bytes: the first 8 bytes, big endian, of their SHA-256.
std::uint64_t object_checksum(std::span<const std::byte> bytes);

/// Cuts the bytes of one object into chunks.
struct ObjectBytes {
  /// Empty bytes stand for an object that is not there.
  ObjectBytes(const ObjectKey& key, Bytes bytes);
  /// Fills all fields but header and receiver.
  void fill(std::uint32_t chunk, msg::ObjectChunk& message) const;
  std::uint32_t chunks() const { return chunk_count(bytes.size()); }

  ObjectKey key;
  Bytes bytes;
  std::uint64_t checksum = 0;
};

/// Sends the objects of one kind to the services that ask, one at a time for each. Every chunk may be lost and asked
/// for again. Used by one thread.
class ObjectServer {
 public:
  /// Returns an object, or null when there is none.
  using Find = std::function<std::shared_ptr<const ObjectBytes>(const ObjectKey& key)>;
  /// `rejected` counts requested chunks that an object does not have, and must outlive this. Requests for what was sent
  /// less than `crossing` ago are dropped: both were under way at once.
  ObjectServer(Find find, std::uint64_t& rejected, std::chrono::milliseconds crossing = kObjectCrossing)
      : find_(std::move(find)), rejected_(rejected), crossing_(crossing) {}

  /// Queues what is asked for, without what is queued or was just sent: a service asks again while it waits.
  void note(const msg::ObjectRequest& request);
  /// Sends each service that asked one object, or as many of its chunks as its requests allow. Fills `chunk` and calls
  /// `publish` for each chunk. Returns whether any objects are left to send.
  bool send(msg::ObjectChunk& chunk, const std::function<void()>& publish);
  /// Sends at once what is asked for.
  void answer(const msg::ObjectRequest& request, msg::ObjectChunk& chunk, const std::function<void()>& publish) {
    note(request);
    while (send(chunk, publish)) continue;
  }

 private:
  struct Wanted {
    ObjectKey key;
    std::vector<std::uint32_t> chunks;  // empty: all from `first` on
    std::uint32_t first;
  };
  struct Order {
    std::deque<Wanted> objects;
    std::size_t most_chunks = 0;  // that its requests allow (MAX_CHUNKS_ASKED each)
  };
  struct Sent {
    Clock::time_point at;
    std::uint32_t next_chunk;  // all before it were sent
  };
  void send_first(const std::string& service, Order& order, msg::ObjectChunk& chunk,
                  const std::function<void()>& publish);

  Find find_;
  std::uint64_t& rejected_;
  std::chrono::milliseconds crossing_;
  std::shared_ptr<const ObjectBytes> found_;                // the last one: large ones take several requests
  std::map<std::string, Order> orders_;                     // by the id of the service that asked
  std::map<std::pair<std::string, ObjectKey>, Sent> sent_;  // less than `crossing` ago
};

}  // namespace citylearn
