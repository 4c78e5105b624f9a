// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace citylearn::simulation {

/// Which services take part in a simulated training.
struct Layout {
  std::string name;
  std::string meaning;   ///< for people
  int environments = 3;  ///< env_services
  int agents = 4;        ///< of each
  int actors = 0;        ///< that act for a learner; 0: one policy_service acts and learns, in lockstep
  int encoders = 0;      ///< encoder_services that share a store; 0: the env_services have features instead of pictures
  int dashboards = 1;    ///< that record
  bool streets = false;  ///< agents walk on a map of streets; else along a line
  int goals = 1;         ///< of a task
  bool replayed = false;   ///< everything is recorded, and replayed to another dashboard after the training
  int updates = 15;        ///< that the training lasts
  int segment = 64;        ///< steps of each agent between updates
  int learned_agents = 0;  ///< whose segments a learner takes for an update; 0: of all

  bool lockstep() const { return actors == 0; }
  int batch() const { return learned_agents > 0 ? learned_agents : environments * agents; }
  /// Returns the steps to learn from.
  std::uint64_t steps() const {
    return static_cast<std::uint64_t>(segment) * static_cast<unsigned>(batch()) * static_cast<unsigned>(updates);
  }
};

/// Returns those that seeds draw from.
const std::vector<Layout>& layouts();
/// Returns the one with this name. Throws Error that lists them.
const Layout& find_layout(const std::string& name);
const Layout& draw_layout(std::uint64_t seed);

}  // namespace citylearn::simulation
