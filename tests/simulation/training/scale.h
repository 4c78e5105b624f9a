// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

namespace citylearn::simulation {

/// Plays a training of so many hosts, each with ten env_services and an actor, beside a learner and two dashboards,
/// without faults, in the current folder, which must be empty. Returns a table of what each topic carried in ten
/// updates, once all env_services are at work, and what an actor was sent that joined then. `progress` is called with a
/// line now and then.
std::string measure_scale(int hosts, const std::function<void(const std::string&)>& progress);

}  // namespace citylearn::simulation
