// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/wire/service.h"
#include "policy_service/rollout/policy.h"
#include "tools/paper/work.h"

namespace citylearn::paper {

/// Acts as `policy` does until Ctrl-C arrives, then throws Stopped: trials on long routes take minutes.
class Stoppable : public Policy {
 public:
  explicit Stoppable(Policy& policy) : policy_(policy) {}
  void begin(std::uint32_t first_task, const SeenFeatures& known) override { policy_.begin(first_task, known); }
  void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) override {
    if (stop_requested()) throw Stopped{};
    policy_.act(observation, choice);
  }
  std::map<std::uint32_t, SeenFeatures> seen() const override { return policy_.seen(); }

 private:
  Policy& policy_;  // outlives this
};

}  // namespace citylearn::paper
