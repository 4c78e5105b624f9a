// SPDX-License-Identifier: Apache-2.0
#include "env_service/scene_sender.h"

#include <utility>

#include "core/exchange/timing.h"

namespace citylearn {

void SceneSender::send(Clock::time_point now, const msg::TraversalInfo& info, const msg::TaskSettings* settings) {
  if (now < next_) return;
  next_ = now + kSceneInterval;
  const int watchers = node_.readers<msg::Scene>();
  const bool more = watchers > std::exchange(watchers_, watchers);
  if (watchers == 0) return;
  const std::uint64_t step = settings ? environment_.ticks() : 0;
  if (!more && scene_.settings() == info.settings() && scene_.step() == step && now < again_) return;
  again_ = now + kHeartbeat;
  scene_ = msg::Scene();
  if (settings) {
    environment_.observe(scene_);
    scene_.task_mode() = settings->task_mode();
    scene_.policy() = settings->policy();
    scene_.first_frame() = settings->first_frame();
    scene_.frames() = settings->frames();
    scene_.belief() = belief_;
  } else {
    scene_.task_mode() = msg::IDLE;
  }
  scene_.settings() = info.settings();
  scene_.traversal() = info.traversal();
  scene_.traversal_hash() = info.hash();
  node_.publish(scene_);
}

}  // namespace citylearn
