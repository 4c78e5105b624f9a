// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "core/files/files.h"
#include "core/util/error.h"
#include "tools/paper/sections/sections.h"
#include "tools/paper/studies/walk.h"

namespace citylearn::paper {
namespace {

constexpr int kPictures = 9;  // in a strip

World& world_of(const Context& context) { return context.world.pictures() ? context.world : context.drawn; }

/// Returns the agents that see, on recordings that have pictures.
std::vector<Study> studies(const Context& context) {
  if (context.world.pictures()) {
    std::vector<Study> all;
    for (const Context::Agent& agent : context.agents)
      if (agent.agent != "baseline") all.push_back(context.study(agent, agent.seeds.front(), context.world));
    return all;
  }
  // On the drawn city: the paper's two agents, each on what it is meant for.
  const std::vector<std::string> known = context.drawn.representations({64});
  const Context::Agent& features = context.paper_agent();
  std::vector<Study> two(2, context.study(features, features.seeds.front(), context.drawn));
  two[0].representation = known.front();
  two[1].agent = "raw_images";
  two[1].representation = known.back();
  for (Study& study : two) {
    study.frames = std::min(128, context.drawn.frames());
    study.deploy_every = 0;
    study.steps = context.steps(study.agent, study.learner);
    study.seconds = (study.agent == "features" ? 100 : 200) * context.effort;
  }
  return two;
}

/// Returns the trial of a training on a traversal; null when there is none.
Json trial(const Context& context, const Json& training, const std::string& traversal) {
  const Json& outcome = context.work.outcome(training["unit"].get<int>());
  if (!outcome.is_null())
    for (const Json& row : outcome["trials"])
      if (row["traversal"] == traversal && !row["shuffled"].get<bool>()) return row;
  return nullptr;
}

/// "night", else where the agent on features does worst, else the traversal learned from.
std::string hardest(const Context& context, const Json& trainings) {
  const std::vector<std::string> names = world_of(context).names();
  if (std::find(names.begin(), names.end(), "night") != names.end()) return "night";
  std::string found = names.size() > 1 ? names[1] : names.front();
  double worst = INFINITY;
  for (const Json& training : trainings)
    for (std::size_t i = 1; i < names.size() && training["agent"] == "features"; ++i)
      if (const Json row = trial(context, training, names[i]); !row.is_null() && row["spl"].get<double>() < worst) {
        worst = row["spl"].get<double>();
        found = names[i];
      }
  return found;
}

/// Which pictures show a walk: frames, and the step each was seen at (null: a goal that was not reached).
Json strip_of(const Json& walk) {
  Json frames = Json::array(), steps = Json::array();
  for (const int step : spread(static_cast<int>(walk["frames"].size()), kPictures)) {
    frames.push_back(walk["frames"][static_cast<std::size_t>(step)]);
    steps.push_back(step);
  }
  if (!walk["completed"].get<bool>()) {
    frames.push_back(walk["goal"]);
    steps.push_back(nullptr);
  }
  return {{"frames", frames}, {"steps", steps}};
}

}  // namespace

Json plan_figure_10(const Context& context) {
  World& world = world_of(context);
  Json trainings = Json::array();
  for (const Study& study : studies(context))
    trainings.push_back({{"agent", study.agent},
                         {"representation", study.representation},
                         {"seed", study.seed},
                         {"frames", study.frames},
                         {"unit", context.work.add(unit_of(study, world))}});
  return {{"recordings", world.description()},
          {"substitute", &world != &context.world},
          {"pictures", context.pictures || world.drawn()},
          {"trainings", trainings}};
}

void complete_figure_10(const Context& context, Json& data) {
  World& world = world_of(context);
  const std::string hard = hardest(context, data["trainings"]);
  data["traversals"] = {world.train()};
  if (hard != world.train()) data["traversals"].push_back(hard);
  data["strips"] = Json::array();
  for (const std::string traversal : data["traversals"])
    for (const Json& training : data["trainings"]) {
      const std::string name = "walk-" + traversal + "-" + training["agent"].get<std::string>() + ".png";
      const std::string path = context.output + "/" + name;
      const Json row = trial(context, training, traversal);
      if (!row.is_null() && data["pictures"].get<bool>()) {
        Json strip = strip_of(row["walk"]);
        write_file(path, strip_png(world.recording(traversal), strip["frames"]));
        strip.update({{"traversal", traversal}, {"agent", training["agent"]}, {"file", name}});
        data["strips"].push_back(strip);
      } else {  // removes the picture of an earlier report
        std::error_code error;
        std::filesystem::remove(path, error);
        if (error) throw Error("cannot be removed: " + error.message(), path);
      }
    }
}

}  // namespace citylearn::paper
