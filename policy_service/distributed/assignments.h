// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/exchange/command.h"

namespace citylearn {

/// Divides the env_services of a learner among its actors, evenly and with as few moves as possible. It handles no
/// messages and has no clock of its own. Used by one thread.
class Assignments {
 public:
  /// An env_service that actors may serve.
  struct Env {
    std::string id;
    std::uint64_t incarnation = 0;
    bool busy = false;  ///< it receives actions, from one of these actors or from another service
  };
  /// An actor that is alive.
  struct Actor {
    std::string id;
    std::set<std::uint64_t> serves;  ///< incarnations of env_services, as it last said
  };
  /// An order to an actor: to serve an env_service, or to release it.
  struct Order {
    std::string actor;
    std::string env;
    std::uint64_t incarnation = 0;
    bool serve = false;

    bool operator==(const Order&) const = default;
  };

  /// Returns the orders that are to be sent now: new ones, and again those that no actor has confirmed. An env_service
  /// is given to another actor only when none says that it serves it, and what an actor did not begin to serve within
  /// kCommandGiveUp goes to another one.
  std::vector<Order> divide(const std::vector<Env>& envs, const std::vector<Actor>& actors, Clock::time_point now);

 private:
  struct Given {
    std::string actor, env;
    CommandSender sender;  ///< of the order to serve it
  };
  using Loads = std::map<std::string, std::size_t>;  // env_services, by actor
  void follow(const std::vector<Env>& envs, const std::vector<Actor>& actors, Clock::time_point now);
  void withdraw_surplus(Loads loads);
  void give(const Env& env, Loads& loads, Clock::time_point now);
  std::vector<Order> due_orders(const std::vector<Env>& envs, const std::vector<Actor>& actors, Clock::time_point now);

  std::map<std::uint64_t, Given> given_;                                     ///< by incarnation of the env_service
  std::map<std::pair<std::string, std::uint64_t>, CommandSender> releases_;  ///< orders to release, by actor and it
  std::map<std::uint64_t, std::string> left_by_;  ///< the actor that released it unasked, or did not begin to serve it
};

}  // namespace citylearn
