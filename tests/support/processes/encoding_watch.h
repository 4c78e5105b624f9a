// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/wire/node.h"
#include "core/wire/transfer.h"
#include "tests/support/wait.h"

namespace citylearn::testing {

inline constexpr seconds kEncodingWait{30};  ///< for what waits for the features of a traversal

/// Hears how the encoder_services of a session divide their work, and fetches the features that they make.
class EncodingWatch {
 public:
  explicit EncodingWatch(const MiddlewareOptions& middleware) : node_({middleware, "watch", "watch", "default"}) {
    node_.create_reader<msg::ServiceStatus>();
    node_.create_reader<msg::TraversalInfo>();
    node_.create_reader<msg::TraversalChunk>();
    node_.create_reader<msg::DescriptorStatus>();
  }

  /// Returns how many frames an encoder_service was the first to have, so that it has encoded them.
  int encoded(const std::string& id) const {
    const auto found = encoded_.find(id);
    return found == encoded_.end() ? 0 : found->second;
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
    while (node_.take(heartbeat_)) continue;
    while (node_.take(status_)) {
      std::vector<std::uint64_t>& announced = announced_[status_.hash()];
      announced.resize(std::max(announced.size(), status_.present().size()));
      for (std::size_t block = 0; block < status_.present().size(); ++block) {
        const std::uint64_t frames = status_.present()[block];
        encoded_[status_.header().sender().c_str()] += std::popcount(frames & ~announced[block]);
        announced[block] |= frames;
      }
    }
    msg::TraversalInfo info;
    while (node_.take(info))
      if (info.encoder_incarnation() != 0) info_[info.traversal().c_str()] = info;
  }

  Node node_;
  std::map<std::uint64_t, std::vector<std::uint64_t>> announced_;  // by hash and block, a bit a frame
  std::map<std::string, int> encoded_;                             // frames, by id
  std::map<std::string, msg::TraversalInfo> info_;                 // completed, by traversal
  msg::ServiceStatus heartbeat_;
  msg::DescriptorStatus status_;
  msg::TraversalChunk chunk_;
};

}  // namespace citylearn::testing
