// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/wire/node.h"
#include "env_service/environment.h"

namespace citylearn {

/// Publishes where the agents of an environment are, for dashboards that watch. Used by the node's thread.
class SceneSender {
 public:
  /// Both must outlive it.
  SceneSender(Node& node, const Environment& environment) : node_(node), environment_(environment) {}

  /// Publishes a scene when one is due and watched. `settings`: those of the agents' episodes; null: they do nothing.
  void send(Clock::time_point now, const msg::TraversalInfo& info, const msg::TaskSettings* settings);
  /// Takes what the agents believe, for the next scenes.
  void set_belief(const msg::Belief& belief) { belief_ = belief; }
  bool watched() const { return watchers_ > 0; }

 private:
  Node& node_;
  const Environment& environment_;
  msg::Scene scene_;  // the last one sent
  msg::Belief belief_;
  Clock::time_point next_, again_;
  int watchers_ = 0;
};

}  // namespace citylearn
