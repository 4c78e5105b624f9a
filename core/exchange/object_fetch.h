// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>

#include "core/exchange/object.h"

namespace citylearn {

/// An object that was fetched. Empty bytes: the server has none.
struct FetchedObject {
  std::uint64_t item = 0;
  Bytes bytes;
};

struct FetchOptions {
  std::uint64_t hash = 0;              ///< of the keys of all objects
  std::uint32_t part = 0;              ///< likewise
  std::chrono::milliseconds retry{0};  ///< without an answer, before it asks again
  int most_tries = 0;                  ///< requests in a row without an answer before it gives up; 0: it never does
  std::uint64_t max_bytes = msg::MAX_OBJECT;     ///< that an object may have
  std::size_t max_items = msg::MAX_ITEMS_ASKED;  ///< in one request
};

/// Fetches objects of one server. It fills requests and takes chunks, in any order and more than once; its owner
/// publishes and receives.
class ObjectFetch {
 public:
  static constexpr int kMaxDamaged = 3;  ///< damaged objects before it gives up; without most_tries it never does

  explicit ObjectFetch(const FetchOptions& options) : options_(options), timer_(options.retry, options.most_tries) {}

  /// Adds an object after those already wanted.
  void want(std::uint64_t item);
  /// Removes an object from those wanted.
  void drop(std::uint64_t item);
  /// Returns how many wanted objects have not come.
  std::size_t missing() const { return wanted_.size(); }

  /// Returns whether the chunk is of an object that is wanted.
  bool wants(const msg::ObjectChunk& chunk) const;
  /// Takes a chunk. Returns kNotWanted if it is of no wanted object or was taken before; kDamaged if its size is wrong,
  /// its object is too large, or it completes an object whose checksum is wrong, which is then asked for anew.
  Taken take(const msg::ObjectChunk& chunk, Clock::time_point now);
  /// Returns the next object that is complete.
  std::optional<FetchedObject> next();
  /// Asks again for an object whose bytes cannot be decoded.
  void refuse(std::uint64_t item);

  /// Returns when a request should go out (RequestTimer).
  Clock::time_point due() const { return timer_.due(); }
  bool gave_up(Clock::time_point now) const {
    return timer_.gave_up(now) || (options_.most_tries > 0 && damaged_ >= kMaxDamaged);
  }
  /// Returns true when a request is due, after filling all of it but its header and server.
  bool ask(Clock::time_point now, msg::ObjectRequest& request);

 private:
  struct Part {
    std::uint64_t checksum;
    Blob blob;
  };
  void remove(const std::deque<std::uint64_t>::iterator& place);

  FetchOptions options_;
  RequestTimer timer_;
  std::deque<std::uint64_t> wanted_;     // items, in the order they are asked for
  std::map<std::uint64_t, Part> parts_;  // of wanted objects, by item
  std::deque<FetchedObject> complete_;
  std::size_t asked_ = 0;  // objects of the last request that have not come
  int damaged_ = 0;        // objects
};

}  // namespace citylearn
