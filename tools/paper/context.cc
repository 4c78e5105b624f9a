// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/context.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "policy_service/learning/trainer.h"

namespace citylearn::paper {
namespace {

/// Half of the recommendation: the curve is flat after a quarter of it.
constexpr double kBaselineSteps = 100000;

int share_of(int tasks, double effort) { return std::max(10, static_cast<int>(std::lround(tasks * effort))); }

}  // namespace

const Context::Agent& Context::paper_agent() const {
  return *std::find_if(agents.begin(), agents.end(), [](const Agent& agent) { return agent.agent == "features"; });
}

int Context::tasks() const { return share_of(quick ? 500 : 2000, effort); }

std::uint64_t Context::steps(const std::string& agent, const std::string& learner) const {
  if (agent == "baseline") return static_cast<std::uint64_t>(std::max(1.0, kBaselineSteps * effort));
  return effort >= 1 ? 0 : share_of_steps({.agent = agent, .learner = learner}, 1);
}

std::uint64_t Context::share_of_steps(const Agent& agent, double share) const {
  const double all = Trainer::recommended_parameters(agent.agent, agent.learner).at("trainer").at("steps");
  return static_cast<std::uint64_t>(std::max(1.0, all * share * effort));
}

std::vector<std::uint64_t> Context::few_seeds() const {
  std::vector<std::uint64_t> few = seeds;
  few.resize(std::min<std::size_t>(few.size(), quick ? 1 : 3));
  return few;
}

Study Context::study(const Agent& agent, std::uint64_t seed, World& where) const {
  Study study;
  study.agent = agent.agent;
  study.learner = agent.learner;
  study.representation = agent.representation;
  study.frames = std::min(frames, where.frames());
  study.seed = seed;
  study.steps = steps(agent.agent, study.learner);
  study.seconds = agent.seconds * effort;
  study.deploy_every = 100;
  study.tasks = tasks();
  study.tasks_between = share_of(quick ? 50 : 100, effort);
  study.traversals = where.names();
  return study;
}

Json Context::add_units(const std::vector<std::uint64_t>& chosen,
                        const std::function<Unit(std::uint64_t)>& unit_of_seed) const {
  Json units = Json::array();
  for (const std::uint64_t seed : chosen) units.push_back(work.add(unit_of_seed(seed)));
  return units;
}

Json Context::add_agent(const Agent& agent, const std::function<Unit(std::uint64_t)>& unit_of_seed) const {
  return {{"agent", agent.agent},
          {"label", label_of(agent.agent)},
          {"learner", agent.learner},
          {"representation", agent.representation},
          {"features", world.features(agent.representation)},
          {"units", add_units(agent.seeds, unit_of_seed)}};
}

Json Context::add_controls(World& where, const std::vector<std::string>& names, Study study) const {
  const auto told = std::move(study.network_parameters);
  Json all = Json::array();
  for (const std::string& name : names) {
    study.agent = name.substr(0, name.find(','));
    study.network_parameters = study.agent == name ? std::map<std::string, double>() : told;
    all.push_back({{"label", name}, {"unit", work.add(control_unit(study, where))}});
  }
  return all;
}

Json Context::compare(World& where, const std::vector<Agent>& compared, const std::vector<std::string>& controls,
                      const std::function<void(Study&)>& change) const {
  Json all = Json::array();
  Study study;
  for (const Agent& agent : compared)
    all.push_back(add_agent(agent, [&](std::uint64_t seed) {
      change(study = this->study(agent, seed, where));
      return unit_of(study, where);
    }));
  return {{"agents", all}, {"controls", add_controls(where, controls, study)}};
}

Json Context::add_agents() const {
  return compare(world, agents, {}, [](Study&) {})["agents"];
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
