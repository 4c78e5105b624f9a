// SPDX-License-Identifier: Apache-2.0
#include "policy_service/learning/trainer_parameters.h"

#include <algorithm>

namespace citylearn {
namespace {

/// Returns a network's recommendations for use with this learner: "relabel.epochs" is for the learner relabel alone,
/// over "epochs", which is for all; "streets.noise-place" is for streets, over both.
std::map<std::string, double> recommended_for(const std::string& learner, const std::map<std::string, double>& all,
                                              bool streets = false) {
  std::map<std::string, double> chosen;
  for (const auto& [name, value] : all)
    if (name.find('.') == name.npos) chosen[name] = value;
  for (const auto& [name, value] : all)
    if (name.starts_with(learner + ".")) chosen[name.substr(learner.size() + 1)] = value;
  for (const auto& [name, value] : all)
    if (streets && name.starts_with("streets.")) chosen[name.substr(8)] = value;
  return chosen;
}

}  // namespace

std::vector<ParameterSpec> Trainer::parameter_specs() {
  return {{"segment", "steps of each agent between updates", 64, 1, 65536, true},
          {"sequence", "steps of backpropagation through time; divides the segment", 64, 1, 65536, true},
          {"steps", "environment steps of the whole run", 40000, 1, 1e12, true},
          {"agents", "recommended number of agents; fewer or more work too", 16, 1, msg::MAX_AGENTS, true},
          {"step-cost", "what a step that leads no nearer costs the learner; 0: 1 / max_steps, as the reward says", 0,
           0, 1},
          {"noise-frame", "noise on features, drawn at each step, relative to their length", 1, 0, 100},
          {"noise-place", "noise of each place, likewise, drawn for each episode", 0, 0, 100},
          {"noise-episode", "shift of all features of an episode, likewise", 3, 0, 100}};
}

TrainerParameters::TrainerParameters(const TrainerOptions& options, bool streets)
    : network_entry(&NetworkRegistry<float>::instance().find("network", options.agent)),
      learner_entry(&LearnerRegistry::instance().find("learner", options.learner)) {
  const std::vector<ParameterSpec> specs = Trainer::parameter_specs();
  std::map<std::string, double> for_learner, for_trainer;
  for (const auto& [name, value] : recommended_for(options.learner, network_entry->recommended, streets)) {
    const auto is_name = [&name = name](const ParameterSpec& spec) { return spec.name == name; };
    if (std::any_of(specs.begin(), specs.end(), is_name))
      for_trainer[name] = value;
    else if (std::any_of(learner_entry->parameters.begin(), learner_entry->parameters.end(), is_name))
      for_learner[name] = value;
    else
      continue;  // another learner may know it
    recommended.insert(name);
  }
  for (const auto& [name, value] : options.learner_parameters) for_learner[name] = value;
  for (const auto& [name, value] : options.trainer_parameters) for_trainer[name] = value;
  network = {"network " + options.agent, network_entry->parameters, options.network_parameters};
  learner = {"learner " + options.learner, learner_entry->parameters, for_learner};
  trainer = {"trainer", specs, for_trainer};
}

std::vector<ParameterSpec> mark_recommended(std::vector<ParameterSpec> specs, const std::string& learner) {
  for (ParameterSpec& spec : specs)
    for (const auto* network : NetworkRegistry<float>::instance().entries())
      spec.recommended |= recommended_for(learner, network->recommended).contains(spec.name);
  return specs;
}

std::map<std::string, std::map<std::string, double>> TrainerParameters::values() const {
  return {{"network", network.values()}, {"learner", learner.values()}, {"trainer", trainer.values()}};
}

std::map<std::string, std::map<std::string, double>> Trainer::recommended_parameters(const std::string& agent,
                                                                                     const std::string& learner) {
  TrainerOptions options;
  options.agent = agent;
  options.learner = learner;
  return TrainerParameters(options).values();
}

}  // namespace citylearn
