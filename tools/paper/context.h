// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tools/paper/studies/study.h"
#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// The state that all sections share.
struct Context {
  World& world;
  World& drawn;  ///< a drawn city that has the pictures and positions `world` may lack; `world` itself when it is drawn
  Work& work;
  std::string output;  ///< the report's folder
  bool quick = false;
  double effort = 1;  ///< share of training steps and tasks, 0..1; below 1 the figures mean nothing
  std::vector<std::uint64_t> seeds;
  int frames = 128;      ///< N of the paper's route
  bool pictures = true;  ///< the report may show real recordings' pictures

  /// An agent that is trained once for each seed.
  struct Agent {
    std::string agent, representation = {};
    std::vector<std::uint64_t> seeds = {};
    double seconds = 0;  ///< estimate for one training with all its steps
    std::string learner = "ppo";
  };
  std::vector<Agent> agents;  ///< those compared, each on the representation it is meant for

  /// The one among them that is the paper's: `features`.
  const Agent& paper_agent() const;
  /// Number of tasks of a trial whose figures go into a table.
  int tasks() const;
  /// Returns the training steps of an agent under `effort`; 0: its recommendation. The baseline needs fewer than that.
  std::uint64_t steps(const std::string& agent, const std::string& learner = "ppo") const;
  /// `share` of the recommended training steps, under `effort`.
  std::uint64_t share_of_steps(const Agent& agent, double share) const;
  /// Returns the seeds of an agent whose training takes long.
  std::vector<std::uint64_t> few_seeds() const;
  /// A training on as many of the first places of `where` as the paper's route has.
  Study study(const Agent& agent, std::uint64_t seed, World& where) const;

  /// Adds a unit for each seed and returns their numbers.
  Json add_units(const std::vector<std::uint64_t>& chosen,
                 const std::function<Unit(std::uint64_t)>& unit_of_seed) const;
  /// Adds a unit for each seed of the agent and returns {"agent", "label", "learner", "representation", "features",
  /// "units"}.
  Json add_agent(const Agent& agent, const std::function<Unit(std::uint64_t)>& unit_of_seed) const;
  /// Adds the named policies, which learn nothing, each on the task of `study`: [{"label", "unit"}]. One named
  /// "CONTROL, told" is given the network's parameters.
  Json add_controls(World& where, const std::vector<std::string>& names, Study study) const;
  /// Adds the trainings of agents, and controls that see what the last of them sees. `change` makes their task: the
  /// route, the recordings, the world's imperfections. Returns {"agents", "controls"}.
  Json compare(World& where, const std::vector<Agent>& compared, const std::vector<std::string>& controls,
               const std::function<void(Study&)>& change) const;
  /// Adds the trainings of `agents` on the paper's route and returns their descriptions.
  Json add_agents() const;
};

/// Returns the name of an agent in figures and tables.
std::string label_of(const std::string& agent);

}  // namespace citylearn::paper
