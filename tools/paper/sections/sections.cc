// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/sections/sections.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace citylearn::paper {
namespace {

/// Half of the recommendation: the curve is flat after a quarter of it.
constexpr double kBaselineSteps = 100000;

int share_of(int tasks, double effort) { return std::max(2, static_cast<int>(std::lround(tasks * effort))); }

/// Returns the name of an agent in figures and tables.
std::string label_of(const std::string& policy) {
  static const std::map<std::string, std::string> labels = {{"baseline", "baseline (sees its position)"},
                                                            {"features", "features (the paper's)"},
                                                            {"raw_images", "raw images"},
                                                            {"place_filter", "place_filter (ours)"}};
  const auto found = labels.find(policy);
  return found == labels.end() ? policy : found->second;
}

Json described(const Study& study, const std::string& label, World& world) {
  return {{"policy", study.policy},
          {"label", label},
          {"learns", !study.control},
          {"learner", study.learner},
          {"representation", study.representation},
          {"features", world.features(study.representation)},
          {"frames", study.frames},
          {"steps", study.steps},
          {"seeds", Json::array()},
          {"imperfections", as_json(study.imperfections)},
          {"parameters", study.parameters},
          {"units", Json::array()}};
}

}  // namespace

const std::vector<Section>& sections() {
  static const std::vector<Section> all = {
      {"figure-2", "Fig. 2: what training costs", figure_2},
      {"figure-7", "Fig. 7: training curves", figure_7},
      {"figure-8-9", "Fig. 8 and 9: deployment and generalisation", figure_8_9},
      {"longer-routes", "Beyond the paper: longer routes", longer_routes},
      {"imperfect-world", "Beyond the paper: an imperfect world", imperfect_world},
      {"dimensions", "The paper's main finding: smaller features generalise better", dimensions}};
  return all;
}

const Agent& Context::paper_agent() const {
  return *std::find_if(agents.begin(), agents.end(), [](const Agent& agent) { return agent.policy == "features"; });
}

int Context::tasks() const { return share_of(quick ? 500 : 2000, effort); }

std::vector<std::uint64_t> Context::few_seeds() const {
  return {seeds.begin(), seeds.begin() + std::min<std::ptrdiff_t>(std::ssize(seeds), quick ? 1 : 3)};
}

Study Context::study(const Agent& agent, std::uint64_t seed, World& where) const {
  Study study;
  study.policy = agent.policy;
  study.learner = agent.learner;
  study.representation = agent.representation;
  study.frames = std::min(frames, where.frames());
  study.seed = seed;
  const bool shortened = agent.policy == "baseline";
  if (shortened || effort < 1) {
    const double recommended = Trainer::recommended_parameters(study.policy, study.learner).at("trainer").at("steps");
    study.steps = static_cast<std::uint64_t>(std::max(1.0, (shortened ? kBaselineSteps : recommended) * effort));
  }
  study.seconds = agent.seconds * effort;
  study.deploy_every = 100;
  study.tasks = tasks();
  study.tasks_between = share_of(quick ? 50 : 100, effort);
  study.traversals = where.names();
  return study;
}

Json planned(const Section& section, const Context& context) {
  const Plan plan = section.plan(context);
  Json points = Json::array();
  for (const Point& point : plan.points) {
    Json policies = Json::array();
    Study study;
    for (const Agent& agent : point.agents) {
      Json row;
      for (const std::uint64_t seed : agent.seeds) {
        point.task(study = context.study(agent, seed, plan.world));
        if (row.is_null()) row = described(study, label_of(agent.policy), plan.world);
        row["seeds"].push_back(seed);
        row["units"].push_back(context.work.add(unit_of(study, plan.world)));
      }
      policies.push_back(row);
    }
    study.control = true;
    const auto told = std::move(study.parameters);
    for (const std::string& name : point.controls) {
      study.policy = name.substr(0, name.find(','));
      study.parameters = study.policy == name ? std::map<std::string, double>() : told;
      policies.push_back(described(study, name, plan.world));
      policies.back()["units"].push_back(context.work.add(unit_of(study, plan.world)));
    }
    points.push_back(policies);
  }
  Json data = plan.more;
  data.update({{"recordings", plan.world.description()}, {"substitute", plan.substitute}, {"points", points}});
  return data;
}

}  // namespace citylearn::paper
