// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "bench/scale/simulation.h"

namespace citylearn::scale {

/// One line of bench_scale: what a service of a kind used, in microseconds and bytes per step of one agent (phase
/// "run") or per second ("idle"), or in all since it began ("start").
struct Used {
  int count = 0;  ///< services of the kind
  std::map<std::string, double> values;
  double operator[](const std::string& column) const;  ///< throws Error when there is no such column
};

/// One layout of services that bench_scale measured.
struct Measured {
  std::string middleware, agent, observing;
  int envs = 0, agents = 0, actors = 0, dimension = 0, update = 0;
  bool dashboard = false, encoder = false, ports = false;
  std::map<std::string, std::map<std::string, Used>> phases;  ///< by phase and kind

  bool ran() const { return phases.contains("run"); }
  const Used& used(const std::string& phase, const std::string& kind) const;  ///< throws Error when there is none
  std::string name() const;
};

/// What bench_scale printed; of several runs the medians. Throws Error that names file and line.
std::vector<Measured> read_measured(const std::vector<std::string>& paths);

/// Whether a case is one that simulate() describes: actors, features by value, and nobody else.
bool simulated(const Measured& measured);

/// Costs with which the processor times of these cases are explained best: least squares of relative errors, none of
/// them negative. All must be of one middleware and one agent.
Costs calibrate(const std::vector<Measured>& cases);

/// The same costs for another agent: only what it computes is fitted, messages cost what they cost.
Costs calibrate_agent(const std::vector<Measured>& cases, Costs costs);

/// Bytes of the messages of `agent` (network), `agents` of one env_service and `dimension` features; `frames` places.
Sizes sizes_of(const std::string& agent, int agents, int dimension, int frames = 128);

/// The layout of a measured case, on as many processors as it had: those it used and those that nobody used.
Layout layout_of(const Measured& measured);
/// Steps of a Trajectory, and Trajectories of an update, as recommended for this agent.
void set_agent(Layout& layout, const std::string& agent, int trainer_agents);

}  // namespace citylearn::scale
