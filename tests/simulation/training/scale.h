// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

namespace citylearn::simulation {

/// Processor time of a service's main thread, in microseconds: for each step of an agent that an env_service makes, an
/// actor acts in, and a learner learns from; and for each message that the learner sends to one actor.
struct Costs {
  double env = 0, actor = 0, learner = 0, copy = 0;
};

/// Plays a training of so many hosts, each with an env_service of 100 agents and an actor, beside a learner, whose main
/// threads take the time that they would take there. Returns how fast it learns.
std::string measure_speed(int hosts, const Costs& costs, const std::function<void(const std::string&)>& progress);

/// Plays a training of so many hosts, each with ten env_services and an actor, beside a learner and two dashboards,
/// without faults, in the current folder, which must be empty. Returns a table of what each topic carried in ten
/// updates, once all env_services are at work, and what an actor was sent that joined then. `progress` is called with a
/// line now and then.
std::string measure_scale(int hosts, const std::function<void(const std::string&)>& progress);

}  // namespace citylearn::simulation
