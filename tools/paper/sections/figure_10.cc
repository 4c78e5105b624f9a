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

/// Returns the trial of a training on a traversal; null when there is none.
Json trial(const Context& context, const Json& training, const std::string& traversal) {
  const Json& outcome = context.work.outcome(training["units"][0].get<int>());
  if (!outcome.is_null())
    for (const Json& row : outcome["trials"])
      if (row["traversal"] == traversal && !row["shuffled"].get<bool>()) return row;
  return nullptr;
}

/// "night", else where the agent on features does worst, else the traversal learned from.
std::string hardest(const Context& context, const Json& trainings) {
  const std::vector<std::string> names = context.with_pictures().names();
  if (std::find(names.begin(), names.end(), "night") != names.end()) return "night";
  std::string found = names.size() > 1 ? names[1] : names.front();
  double worst = INFINITY;
  for (const Json& training : trainings)
    for (std::size_t i = 1; i < names.size() && training["policy"] == "features"; ++i)
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

Plan figure_10(const Context& context) {
  World& world = context.with_pictures();
  const bool substitute = &world != &context.world;
  std::vector<Agent> agents;
  for (Agent agent : context.agents) {
    agent.seeds.resize(1);
    if (!substitute && agent.policy != "baseline") agents.push_back(agent);
  }
  if (substitute) {  // on the drawn city: the paper's two agents, each on what it is meant for
    const std::vector<std::string> known = world.representations({64});
    const std::vector<std::uint64_t> seed = {context.paper_agent().seeds.front()};
    agents = {{"features", known.front(), seed, 100}, {"raw_images", known.back(), seed, 200}};
  }
  const auto task = [&world, substitute](Study& study) {
    if (!substitute) return;
    study.frames = std::min(128, world.frames());
    study.deploy_every = 0;
  };
  return {world, {{agents, {}, task}}, {{"pictures", context.pictures || world.drawn()}}, substitute};
}

void complete_figure_10(const Context& context, Json& data) {
  World& world = context.with_pictures();
  const Json& trainings = data["points"][0];
  const std::string hard = hardest(context, trainings);
  data["traversals"] = {world.train()};
  if (hard != world.train()) data["traversals"].push_back(hard);
  data["strips"] = Json::array();
  for (const std::string traversal : data["traversals"])
    for (const Json& training : trainings) {
      const std::string name = "walk-" + traversal + "-" + training["policy"].get<std::string>() + ".png";
      const std::string path = context.output + "/" + name;
      const Json row = trial(context, training, traversal);
      if (!row.is_null() && data["pictures"].get<bool>()) {
        Json strip = strip_of(row["walk"]);
        write_file(path, strip_png(world.recording(traversal), strip["frames"]));
        strip.update({{"traversal", traversal}, {"agent", training["policy"]}, {"file", name}});
        data["strips"].push_back(strip);
      } else {  // removes the picture of an earlier report
        std::error_code error;
        std::filesystem::remove(path, error);
        if (error) throw Error("cannot be removed: " + error.message(), path);
      }
    }
}

}  // namespace citylearn::paper
