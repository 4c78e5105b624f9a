// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tools/paper/studies/study.h"

namespace citylearn::paper {

/// An agent that is trained once for each seed.
struct Agent {
  std::string policy, representation;
  std::vector<std::uint64_t> seeds;
  double seconds = 0;  ///< estimate for one training with all its steps
  std::string learner = "ppo";
};

/// The state that all sections share.
struct Context {
  World& world;
  World& drawn;  ///< a drawn city that has the pictures and positions `world` may lack; `world` itself when it is drawn
  Work& work;
  bool quick = false;
  double effort = 1;  ///< share of training steps and tasks, 0..1; below 1 the figures mean nothing
  std::vector<std::uint64_t> seeds;
  int frames = 128;           ///< N of the paper's route
  std::vector<Agent> agents;  ///< those compared, each on the representation it is meant for

  /// The one among them that is the paper's: `features`.
  const Agent& paper_agent() const;
  World& with_pictures() const { return world.pictures() ? world : drawn; }
  /// Number of tasks of a trial whose figures go into a table.
  int tasks() const;
  /// Returns the seeds of an agent whose training takes long.
  std::vector<std::uint64_t> few_seeds() const;
  /// A training on as many of the first places of `where` as the paper's route has.
  Study study(const Agent& agent, std::uint64_t seed, World& where) const;
};

/// Policies that are compared on the same task.
struct Point {
  std::vector<Agent> agents;
  std::vector<std::string> controls = {};            ///< on the last agent's task; "NAME, told" has its parameters too
  std::function<void(Study&)> task = [](Study&) {};  ///< sets the route, the recordings, the world's imperfections
};

/// The studies of a section.
struct Plan {
  World& world;
  std::vector<Point> points = {};
  Json more = Json::object();  ///< what else its page has to know
  bool substitute = false;     ///< drawn recordings take the place of the given ones, which lack what it needs
};

/// A part of the report. report/report.py names the function that makes its figures, tables and text.
struct Section {
  std::string name;   ///< for --only: "figure-7"
  std::string title;  ///< "Fig. 7: training curves"
  Plan (*plan)(const Context& context);
};

/// Returns all sections, in the order of the report.
const std::vector<Section>& sections();

/// Adds the units of work of a section and returns what its page has to know: Plan::more, "recordings", "substitute"
/// and "points", for each [{"policy", "label", "learns", "learner", "representation", "features", "frames",
/// "steps", "seeds", "imperfections", "parameters", "units"}], agents before controls. A
/// unit is its place in results.json.
Json planned(const Section& section, const Context& context);

Plan figure_2(const Context& context);
Plan figure_7(const Context& context);
Plan figure_8_9(const Context& context);
/// The paper's main finding, tried: agents that learn from more and fewer features of the same encoder.
Plan dimensions(const Context& context);
Plan longer_routes(const Context& context);
/// Actions slip, frames are dropped and agents are carried elsewhere, in training and in trials.
Plan imperfect_world(const Context& context);

}  // namespace citylearn::paper
