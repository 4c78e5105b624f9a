// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <exception>

#include "core/wire/node.h"

namespace citylearn {

/// Says at the end of its life that this service stops, or that it failed, so that whoever watches need not miss it.
class Farewell {
 public:
  explicit Farewell(Node& node) : node_(node), unwinding_(std::uncaught_exceptions()) {}
  ~Farewell() {
    const bool failed = std::uncaught_exceptions() > unwinding_;
    try {
      node_.report(failed ? msg::FAILED : msg::STOPPING, failed ? "failed: its log says why" : "stopping");
    } catch (const Error&) {  // then it is missed
    }
  }
  Farewell(const Farewell&) = delete;
  Farewell& operator=(const Farewell&) = delete;

 private:
  Node& node_;
  const int unwinding_;
};

}  // namespace citylearn
