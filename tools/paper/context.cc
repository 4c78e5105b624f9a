// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/context.h"

#include <algorithm>
#include <cmath>

#include "policy_service/learning/trainer.h"

namespace citylearn::paper {
namespace {

/// Half of the recommendation: the curve is flat after a quarter of it.
constexpr double kBaselineSteps = 100000;

int share_of(int tasks, double effort) { return std::max(10, static_cast<int>(std::lround(tasks * effort))); }

}  // namespace

int Context::tasks() const { return share_of(quick ? 500 : 2000, effort); }

int Context::tasks_between() const { return share_of(quick ? 50 : 100, effort); }

std::uint64_t Context::steps(const std::string& agent, const std::string& learner) const {
  if (effort >= 1 && agent != "baseline") return 0;
  const double all =
      agent == "baseline" ? kBaselineSteps : Trainer::recommended_parameters(agent, learner).at("trainer").at("steps");
  return static_cast<std::uint64_t>(std::max(1.0, all * effort));
}

std::vector<std::uint64_t> Context::few_seeds() const {
  std::vector<std::uint64_t> few = seeds;
  few.resize(std::min<std::size_t>(few.size(), quick ? 1 : 3));
  return few;
}

Study Context::study(const Agent& agent, std::uint64_t seed) const {
  Study study;
  study.agent = agent.agent;
  study.learner = agent.learner;
  study.representation = agent.representation;
  study.frames = frames;
  study.seed = seed;
  study.steps = steps(agent.agent, study.learner);
  study.seconds = agent.seconds * effort;
  study.deploy_every = 100;
  study.tasks = tasks();
  study.tasks_between = tasks_between();
  study.traversals = world.names();
  return study;
}

int Context::features(const Agent& agent) const {
  if (agent.representation == "features") return world.recording(world.train()).dimension;
  const std::size_t dash = agent.representation.rfind('-');
  return dash == std::string::npos ? 0 : std::stoi(agent.representation.substr(dash + 1));
}

Json Context::description(const Agent& agent, Json units) const {
  return {{"agent", agent.agent},        {"label", label_of(agent.agent)},
          {"learner", agent.learner},    {"representation", agent.representation},
          {"features", features(agent)}, {"units", std::move(units)}};
}

Json Context::add_agents() const {
  Json all = Json::array();
  for (const Agent& agent : agents)
    all.push_back(add_agent(agent, [&](std::uint64_t seed) { return unit_of(study(agent, seed), world); }));
  return all;
}

Json Context::add_controls(World& where, const std::vector<std::string>& names, ControlStudy study) const {
  Json all = Json::array();
  for (const std::string& name : names) {
    study.control = name;
    all.push_back({{"label", name}, {"unit", work.add(unit_of(study, where))}});
  }
  return all;
}

std::string label_of(const std::string& agent) {
  static const std::map<std::string, std::string> labels = {{"baseline", "baseline (sees its position)"},
                                                            {"features", "features (the paper's)"},
                                                            {"raw_images", "raw images"},
                                                            {"place_filter", "place_filter (ours)"}};
  const auto found = labels.find(agent);
  return found == labels.end() ? agent : found->second;
}

}  // namespace citylearn::paper
