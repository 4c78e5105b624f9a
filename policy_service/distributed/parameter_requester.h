// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "core/wire/node.h"
#include "policy_service/distributed/parameter_chunks.h"

namespace citylearn {

/// Asks a learner for parameters that were lost, or were sent before this actor started. Used by one thread.
class ParameterRequester {
 public:
  ParameterRequester(Node& node, const std::string& learner) : node_(node) { request_.learner() = learner.c_str(); }
  /// Sends a request when it is time to: for more at once when all that was asked for has arrived.
  void request_missing(ParameterAssembly& parameters);

 private:
  Node& node_;
  msg::ParametersRequest request_;
  std::optional<ParameterAssembly::Missing> asked_;
  Clock::time_point next_{};
  int unanswered_ = 0;  ///< requests in a row of which nothing arrived
};

}  // namespace citylearn
