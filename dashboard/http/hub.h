// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace citylearn {

/// Between those who have news and the WebSocket clients who watch (docs/reference/dashboard-api.md). May be used by
/// any thread; never waits for a client.
class Hub {
 public:
  /// What becomes of news of a topic for a client who has not taken the last ones yet.
  enum class Merge {
    kReplace,  ///< the newest replaces them
    kAppend,   ///< rows are joined (header "rows", payload row-major), the oldest go beyond a bound
    kEach      ///< each is kept, the oldest go beyond a bound
  };
  virtual ~Hub() = default;
  /// `header` gets topic, sequence and dropped when it is sent. Does nothing where nobody watches.
  virtual void publish(const std::string& topic, nlohmann::json header, std::vector<std::byte> payload,
                       Merge merge) = 0;
  /// Topics that somebody watches now.
  virtual std::vector<std::string> watched() const = 0;
};

}  // namespace citylearn
