// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <memory>
#include <string>

#include "core/exchange/command.h"
#include "core/exchange/incumbent.h"
#include "core/exchange/message_order.h"
#include "core/exchange/timing.h"
#include "core/task/state_map.h"
#include "core/wire/node.h"
#include "policy_service/env_client/feature_cache.h"

namespace citylearn {

/// One env_service as a policy_service sees it.
struct EnvHandle {
  std::string id;
  msg::TraversalInfo info;                  ///< of the running incarnation
  msg::TaskSettings settings;               ///< those commanded last; version 0 = none
  std::uint32_t given = 0;                  ///< newest version that it was given; stays when it is released
  std::uint64_t next_step = 0;              ///< step of the observation to be answered next, under `settings`
  bool waiting = false;                     ///< that observation has arrived and waits for answer()
  bool wants_belief = false;                ///< as that observation has it
  MessageOrder order;                       ///< of its TraversalInfos
  Incumbent presence;                       ///< which process speaks for the id, and when it was last heard
  Presence observed;                        ///< when an observation under `settings` came last
  msg::Action last_action;                  ///< sent again when the observation it answers is repeated
  CommandSender settings_sender;            ///< sends `settings` until a message of the env_service carries their id
  std::shared_ptr<const StateMap> streets;  ///< where it walks, once its map is here; null on a line
  bool joining = false;                     ///< it fits and joins once its street map is here
  /// Features of the route, for observations by reference. The settings are sent once these are complete.
  std::shared_ptr<RouteFeatures> features;
  std::uint64_t obeys = 0;          ///< incarnation of the policy_service whose settings are in force; 0: none are
  Clock::time_point commanded{};    ///< when `settings` were given
  Clock::time_point heard_other{};  ///< since when it obeys another policy_service; the clock's epoch: it does not
  std::uint64_t acknowledged = 0;   ///< the last episode acknowledged; all before it are too
  bool episodes_missing = false;    ///< one did not arrive, though a later one did
  bool busy = false;                ///< the env_service reports that it receives actions
  std::string failure;              ///< what it reports where it fails, as which settings it refused; or empty
  std::string refusal;              ///< why it is not used; empty: it is
  bool until_restart = false;       ///< it stays refused whatever it announces
  int invalid = 0;                  ///< invalid observations since the last valid one

  /// Returns whether it was given settings and has confirmed them.
  bool in_force() const { return commands() && !settings_sender.unconfirmed(); }
  /// Returns whether it was given settings, and not released since.
  bool commands() const { return settings.settings().version() != 0; }
  /// Returns whether it was heard lately.
  bool alive() const { return presence.here(Clock::now()); }
  bool on_streets() const { return info.rule() != msg::LINE; }
  /// Returns whether it was heard lately, is not refused, and its street map is here, if it has one.
  bool usable() const { return refusal.empty() && alive() && (streets || !on_streets()); }
  /// Returns whether it has obeyed another policy_service for kObeysOther, and this one's settings are as old.
  bool lost() const {
    return commands() && heard_other != Clock::time_point{} &&
           Clock::now() >= std::max(heard_other, commanded) + kObeysOther;
  }
  /// Forgets the settings, so that they are not sent again.
  void release() {
    settings = msg::TaskSettings();
    waiting = false;
    features.reset();
  }
  std::string traversal() const { return info.traversal().c_str(); }
  std::uint64_t incarnation() const { return info.header().incarnation(); }
};

/// Orders env_services by their ids. Their addresses would order them differently in every process.
struct ById {
  bool operator()(const EnvHandle* a, const EnvHandle* b) const { return a->id < b->id; }
};

}  // namespace citylearn
