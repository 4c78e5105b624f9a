// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "core/exchange/object_fetch.h"
#include "core/wire/messages.h"

namespace citylearn {

/// Returns how many frames one Traversal object has (idl/object.idl); the last one may have fewer.
std::uint32_t frames_per_object(std::uint32_t dimension);

/// Returns the Traversal object of a key whose `part` is D, or null where the traversal has no frame `item`, or no
/// object begins there. `features(frame)` gives D floats, and is not called when D is 0.
std::shared_ptr<const ObjectBytes> traversal_object(
    const ObjectKey& key, std::span<const float> positions,
    const std::function<std::span<const float>(std::uint32_t frame)>& features);

/// Fetches the positions and features of consecutive frames. Publishes nothing itself.
class Transfer {
 public:
  struct What {
    std::uint64_t hash = 0;  ///< of the traversal
    std::uint32_t frames = 0;
    std::uint32_t dimension = 0;  ///< D
    std::uint32_t first = 0;      ///< frames first .. first + count - 1 of the traversal
    std::uint32_t count = 0;      ///< 0: up to the last frame
  };

  explicit Transfer(const What& what);

  /// As ObjectFetch::take(). kDamaged also where an object means nothing: it has another number of frames or features
  /// than it should have, or numbers that are not finite (a position may be NaN); nothing of it is used.
  Taken take(const msg::TraversalChunk& chunk);
  /// Returns whether the chunk belongs to what is still missing.
  bool wants(const msg::TraversalChunk& chunk) const { return objects_.wants(chunk); }
  bool complete() const { return missing() == 0; }
  /// Returns how many objects are missing.
  std::size_t missing() const { return objects_.missing(); }
  const What& what() const { return what_; }
  /// Returns when a request should go out (RequestTimer).
  Clock::time_point due() const { return objects_.due(); }
  /// Fills all of a request but its header and server, and returns true, when one is due.
  bool ask(Clock::time_point now, msg::TraversalRequest& request) { return objects_.ask(now, request); }

  std::vector<float> positions;  ///< count, metres; NaN where unknown
  std::vector<float> features;   ///< count x D, frame-major

 private:
  bool put(const FetchedObject& object);

  What what_;
  ObjectFetch objects_;
};

}  // namespace citylearn
