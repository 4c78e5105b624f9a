// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "core/wire/node.h"
#include "core/wire/transfer.h"
#include "tests/support/wait.h"

namespace citylearn::testing {

inline constexpr seconds kEncodingWait{30};  ///< for what waits for the features of a traversal

/// Fetches the features that the encoder_services of a session make.
class EncodingWatch {
 public:
  explicit EncodingWatch(const MiddlewareOptions& middleware) : node_({middleware, "watch", "watch", "default"}) {
    node_.create_reader<msg::TraversalInfo>();
    node_.create_reader<msg::TraversalChunk>();
  }

  bool until(const std::function<bool()>& condition, milliseconds patience) {
    return eventually([this] { spin(); }, condition, patience * kSlowness);
  }
  /// Fetches the features of a traversal's frames from `encoder`, once that one serves them; empty: it does not.
  std::vector<float> features(const std::string& traversal, const std::string& encoder, milliseconds patience) {
    const auto served = [&] {
      return info_.contains(traversal) && std::string(info_[traversal].encoder_service().c_str()) == encoder;
    };
    if (!until(served, patience)) return {};
    const msg::TraversalInfo info = info_[traversal];
    Transfer transfer({info.hash(), info.frames(), info.feature_dimension()});
    msg::TraversalRequest request;
    const auto come = [&] {
      if (transfer.ask(Clock::now(), request)) {
        request.server() = info.header().sender();
        node_.publish(request);
      }
      while (node_.take(chunk_)) transfer.take(chunk_);
      return transfer.complete();
    };
    return until(come, patience) ? transfer.features : std::vector<float>();
  }

 private:
  void spin() {
    node_.wait(Clock::now() + milliseconds(5));
    msg::TraversalInfo info;
    while (node_.take(info))
      if (info.encoder_incarnation() != 0) info_[info.traversal().c_str()] = info;
  }

  Node node_;
  std::map<std::string, msg::TraversalInfo> info_;  // completed, by traversal
  msg::TraversalChunk chunk_;
};

}  // namespace citylearn::testing
