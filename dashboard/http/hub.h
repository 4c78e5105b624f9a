// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace citylearn {

/// Passes messages from publishers to the WebSocket clients that watch their topic (docs/reference/dashboard-api.md).
/// May be used by any thread; never waits for a client.
class Hub {
 public:
  /// Says how a new message of a topic joins those that a client has not taken yet.
  enum class Merge {
    kReplace,  ///< the newest replaces them
    kAppend,   ///< rows are joined (header "rows", payload row-major); beyond a bound the oldest are dropped
    kEach      ///< each is kept; beyond a bound the oldest are dropped
  };
  virtual ~Hub() = default;
  /// Adds topic, sequence and dropped to `header`. Does nothing for a topic without watchers.
  virtual void publish(const std::string& topic, nlohmann::json header, std::vector<std::byte> payload,
                       Merge merge) = 0;
  /// Returns the topics that are watched now.
  virtual std::vector<std::string> watched() const = 0;
};

}  // namespace citylearn
