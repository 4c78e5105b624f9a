// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/spdlog.h>

#include <set>
#include <string>

#include "core/wire/node.h"

namespace citylearn {

/// Counts messages that a service does not believe though they could be decoded, and logs the first one of each kind: a
/// peer that sends nonsense sends a lot of it. Used by the node's thread.
class Rejections {
 public:
  explicit Rejections(Node& node) : node_(node) {}

  /// `kind`: what is wrong ("an action of who is not in charge"). `detail` is of this one.
  void add(const msg::Header& header, const std::string& kind, const std::string& detail = "") {
    ++node_.traffic.rejected;
    if (logged_.size() < kMost && logged_.insert(kind).second)
      spdlog::warn("rejected {} from '{}'{}{} (more of the kind are counted, not logged)", kind,
                   header.sender().c_str(), detail.empty() ? "" : ": ", detail);
  }

 private:
  static constexpr std::size_t kMost = 64;
  Node& node_;
  std::set<std::string> logged_;
};

}  // namespace citylearn
