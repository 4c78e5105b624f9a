// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <exception>

#include "core/wire/node.h"

namespace citylearn {

/// Reports at the end of its life that this service stops, or that it failed, so that watchers need not time out.
class FinalStatusGuard {
 public:
  explicit FinalStatusGuard(Node& node) : node_(node), unwinding_(std::uncaught_exceptions()) {}
  ~FinalStatusGuard() {
    const bool failed = std::uncaught_exceptions() > unwinding_;
    try {
      node_.report(failed ? msg::FAILED : msg::STOPPING, failed ? "failed: its log says why" : "stopping");
    } catch (const Error&) {  // watchers then time out
    }
  }
  FinalStatusGuard(const FinalStatusGuard&) = delete;
  FinalStatusGuard& operator=(const FinalStatusGuard&) = delete;

 private:
  Node& node_;
  const int unwinding_;
};

}  // namespace citylearn
