// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>

#include "core/wire/node.h"

namespace citylearn {

/// Counts messages that could be decoded but are rejected, and logs the first one of each kind, because a peer that
/// sends wrong messages sends many. Used by the node's thread.
class Rejections {
 public:
  explicit Rejections(Node& node) : node_(node) {}

  /// `kind`: what is wrong ("an action of a service that is not in charge"). `detail` is about this message.
  void add(const msg::Header& header, const std::string& kind, const std::string& detail = "");

 private:
  Node& node_;
  std::set<std::string> logged_;
};

}  // namespace citylearn
