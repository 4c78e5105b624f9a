// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/assignments.h"

#include <algorithm>
#include <iterator>

#include "idl/trajectory.h"

namespace citylearn {
namespace {

constexpr auto kByLoad = [](const auto& a, const auto& b) { return a.second < b.second; };

}  // namespace

/// Updates given_ from the actors that are alive and what they say.
void Assignments::follow(const std::vector<Env>& envs, const std::vector<Actor>& actors, Clock::time_point now) {
  std::map<std::uint64_t, const Env*> present;
  for (const Env& env : envs) present[env.incarnation] = &env;
  std::map<std::string, const Actor*> alive;
  for (const Actor& actor : actors) alive[actor.id] = &actor;
  std::erase_if(left_by_, [&](const auto& entry) { return !present.contains(entry.first); });
  for (auto entry = given_.begin(); entry != given_.end();) {
    auto& [incarnation, given] = *entry;
    const auto actor = alive.find(given.actor);
    const bool here = present.contains(incarnation) && actor != alive.end();
    const bool serves = here && actor->second->serves.contains(incarnation);
    const bool left =
        here && !serves && (!given.sender.unconfirmed() || given.sender.unconfirmed_for(now) > kCommandGiveUp);
    if (left) left_by_[incarnation] = given.actor;
    if (serves) given.sender.confirm();
    entry = here && !left ? std::next(entry) : given_.erase(entry);
  }
  // What actors serve already, as a learner finds it when it starts again.
  for (const Actor& actor : actors)
    for (const std::uint64_t incarnation : actor.serves)
      if (const auto env = present.find(incarnation); env != present.end())
        given_.try_emplace(incarnation, Given{actor.id, env->second->id, {}});
}

/// Withdraws env_services from actors that have more than their share while others have less. `loads` counts what each
/// will have when all others are given out.
void Assignments::withdraw_surplus(Loads loads) {
  while (true) {
    const auto [least, most] = std::minmax_element(loads.begin(), loads.end(), kByLoad);
    if (most->second <= least->second + 1) return;
    auto last = given_.end();
    for (auto entry = given_.begin(); entry != given_.end(); ++entry)
      if (entry->second.actor == most->first && (last == given_.end() || entry->second.env > last->second.env))
        last = entry;
    if (last == given_.end()) return;
    given_.erase(last);
    --most->second;
    ++least->second;
  }
}

/// Gives an env_service to the actor that has fewest; to the one that left it only if no other one has as few.
void Assignments::give(const Env& env, Loads& loads, Clock::time_point now) {
  const auto left = left_by_.find(env.incarnation);
  const auto key = [&](const auto& load) {
    return std::pair(load.second, left != left_by_.end() && left->second == load.first);
  };
  const auto best =
      std::min_element(loads.begin(), loads.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
  if (best == loads.end() || best->second >= msg::MAX_SERVED) return;
  Given& given = given_[env.incarnation] = {best->first, env.id, {}};
  given.sender.begin(now);
  ++best->second;
}

std::vector<Assignments::Order> Assignments::divide(const std::vector<Env>& envs, const std::vector<Actor>& actors,
                                                    Clock::time_point now) {
  follow(envs, actors, now);
  Loads loads;
  std::set<std::uint64_t> served;
  for (const Actor& actor : actors) {
    loads[actor.id] = 0;
    served.insert(actor.serves.begin(), actor.serves.end());
  }
  for (const auto& [incarnation, given] : given_) ++loads[given.actor];
  std::size_t later = 0;  // to be given out
  for (const Env& env : envs) {
    if (given_.contains(env.incarnation)) continue;
    if (served.contains(env.incarnation) || env.busy)
      ++later;
    else
      give(env, loads, now);
  }
  if (!actors.empty()) {
    Loads shares = loads;
    for (; later > 0; --later) ++std::min_element(shares.begin(), shares.end(), kByLoad)->second;
    withdraw_surplus(std::move(shares));
  }
  return due_orders(envs, actors, now);
}

/// Returns the orders that make what the actors serve what was given to them, as far as they are to be sent now.
std::vector<Assignments::Order> Assignments::due_orders(const std::vector<Env>& envs, const std::vector<Actor>& actors,
                                                        Clock::time_point now) {
  std::vector<Order> orders;
  const auto earlier = std::exchange(releases_, {});
  for (const Actor& actor : actors) {
    for (auto& [incarnation, given] : given_)
      if (given.actor == actor.id && given.sender.take_due(now))
        orders.push_back({actor.id, given.env, incarnation, true});
    for (const std::uint64_t incarnation : actor.serves) {
      const auto given = given_.find(incarnation);
      if (given != given_.end() && given->second.actor == actor.id) continue;
      const auto env =
          std::find_if(envs.begin(), envs.end(), [&](const Env& each) { return each.incarnation == incarnation; });
      if (env == envs.end()) continue;
      CommandSender& sender = releases_[{actor.id, incarnation}];
      if (const auto known = earlier.find({actor.id, incarnation}); known != earlier.end())
        sender = known->second;
      else
        sender.begin(now);
      if (sender.take_due(now)) orders.push_back({actor.id, env->id, incarnation, false});
    }
  }
  return orders;
}

}  // namespace citylearn
