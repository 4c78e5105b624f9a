// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/other_actors.h"

#include <algorithm>

namespace citylearn {

void OtherActors::on_status(const msg::ActorStatus& status) {
  const std::string id = status.header().sender().c_str();
  if (id == node_.options().id) return;  // Node::check_twin
  Actor& actor = actors_[id];
  if (actor.presence.hear(status.header().incarnation(), Clock::now()) == Incumbent::Heard::kOther) return;
  actor.environments = std::set<std::uint64_t>(status.environments().begin(), status.environments().end());
}

void OtherActors::forget_gone() {
  std::erase_if(actors_, [&](const auto& entry) { return !entry.second.presence.here(Clock::now()); });
}

const std::string* OtherActors::serving(std::uint64_t env_incarnation) const {
  for (const auto& [id, actor] : actors_)
    if (actor.environments.contains(env_incarnation)) return &id;
  return nullptr;
}

OtherActors::Share OtherActors::share_of(std::size_t envs) const {
  const std::size_t all = actors_.size() + 1;
  const auto before = static_cast<std::size_t>(std::count_if(
      actors_.begin(), actors_.end(), [&](const auto& entry) { return entry.first < node_.options().id; }));
  return {std::min<std::size_t>(envs / all + (before < envs % all ? 1 : 0), msg::MAX_SERVED), before};
}

}  // namespace citylearn
