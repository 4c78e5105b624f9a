// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/paper/studies/study.h"
#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// What all sections share.
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
    std::string agent, representation;
    std::vector<std::uint64_t> seeds;
    double seconds = 0;  ///< estimate for one training with all its steps
    std::string learner = "ppo";
  };
  std::vector<Agent> agents;  ///< those compared, each on the representation it is meant for

  /// Number of tasks of a trial whose figures go into a table, and of one during training.
  int tasks() const;
  int tasks_between() const;
  /// Training steps of an agent under `effort`; 0: its recommendation. The baseline needs fewer than that.
  std::uint64_t steps(const std::string& agent, const std::string& learner = "ppo") const;
  /// The seeds of an agent whose training takes long.
  std::vector<std::uint64_t> few_seeds() const;
  /// A training on the paper's route.
  Study study(const Agent& agent, std::uint64_t seed) const;
  /// Features a frame that an agent is given; 0: pixels.
  int features(const Agent& agent) const;

  /// Adds a unit for each seed and returns their numbers.
  template <class UnitOfSeed>
  Json add_units(const std::vector<std::uint64_t>& chosen, const UnitOfSeed& unit_of_seed) const {
    Json units = Json::array();
    for (const std::uint64_t seed : chosen) units.push_back(work.add(unit_of_seed(seed)));
    return units;
  }
  /// Adds a unit for each seed of the agent and returns {"agent", "label", "learner", "representation", "features",
  /// "units"}.
  template <class UnitOfSeed>
  Json add_agent(const Agent& agent, const UnitOfSeed& unit_of_seed) const {
    return description(agent, add_units(agent.seeds, unit_of_seed));
  }
  /// Adds the trainings of all agents on the paper's route and returns their descriptions.
  Json add_agents() const;
  /// Adds the named policies, which learn nothing, each on the task of `study`: [{"label", "unit"}].
  Json add_controls(World& where, const std::vector<std::string>& names, ControlStudy study) const;

 private:
  Json description(const Agent& agent, Json units) const;
};

/// The name of an agent in figures and tables.
std::string label_of(const std::string& agent);

}  // namespace citylearn::paper
