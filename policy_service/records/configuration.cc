// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/configuration.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/text.h"
#include "policy_service/learning/trainer_parameters.h"
#include "policy_service/rollout/control.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxValueWidth = 32;  // longer ones, such as paths, push the origin to the right

constexpr std::size_t kListWidth = 100;  // columns

const std::set<std::string> kPrinting = {"--list", "--show-config", "runs"};

/// The parameters of one plug-in.
struct PluginParameters {
  std::string prefix;
  std::map<std::string, double> values;
};

template <class Registry>
void add_option_names(const Registry& registry, std::set<std::string>& names) {
  for (const auto* entry : registry.entries())
    for (const ParameterSpec& spec : entry->parameters) names.insert("--" + entry->name + "-" + spec.name);
}

/// Returns the names of the options of all plug-ins' parameters.
std::set<std::string> parameter_options() {
  std::set<std::string> names;
  add_option_names(NetworkRegistry<float>::instance(), names);
  add_option_names(LearnerRegistry::instance(), names);
  add_option_names(ControlRegistry::instance(), names);
  for (const ParameterSpec& spec : Trainer::parameter_specs()) names.insert("--trainer-" + spec.name);
  return names;
}

/// Returns the parameters of the controls that are evaluated.
std::vector<PluginParameters> control_parameters(const PolicyServiceOptions& options) {
  std::vector<PluginParameters> parts;
  for (const auto* entry : ControlRegistry::instance().entries()) {
    const auto& names = options.controls;
    if (entry->name != options.agent && std::find(names.begin(), names.end(), entry->name) == names.end()) continue;
    const auto given = options.control_parameters.find(entry->name);
    const Parameters all("control " + entry->name, entry->parameters,
                         given == options.control_parameters.end() ? std::map<std::string, double>() : given->second);
    parts.push_back({entry->name, all.values()});
  }
  return parts;
}

}  // namespace

std::vector<OptionValue> effective_configuration(const PolicyServiceOptions& options,
                                                 const std::vector<OptionValue>& parsed) {
  std::vector<PluginParameters> parts = control_parameters(options);
  std::map<std::string, std::string> replaced = {{"--max-steps", std::to_string(options.max_steps)}};
  std::set<std::string> recommended;  // names of options
  if (options.mode == "train" && options.role != "actor") {
    TrainerOptions trainer = options;
    if (options.steps > 0) trainer.trainer_parameters["steps"] = static_cast<double>(options.steps);
    const TrainerParameters all(trainer);
    parts.insert(parts.end(), {{options.agent, all.network.values()},
                               {options.learner, all.learner.values()},
                               {"trainer", all.trainer.values()}});
    for (const std::string& name : all.recommended)
      for (const std::string& prefix : {options.learner, std::string("trainer")})
        recommended.insert("--" + prefix + "-" + name);
  }
  if (options.ranks_domain)
    replaced.insert({{"--rank", std::to_string(options.rank)}, {"--ranks", std::to_string(options.ranks)}});
  for (const PluginParameters& part : parts)
    for (const auto& [name, value] : part.values)
      replaced["--" + part.prefix + "-" + name] = fmt::format("{:.10g}", value);

  const std::set<std::string> of_plugins = parameter_options();
  std::vector<OptionValue> configuration;
  for (OptionValue option : parsed) {
    const auto value = replaced.find(option.name);
    if (kPrinting.contains(option.name) || (of_plugins.contains(option.name) && value == replaced.end())) continue;
    if (value != replaced.end()) option.value = value->second;
    if (option.origin == kDefaultOrigin && recommended.contains(option.name))
      option.origin = "recommended by " + options.agent;
    configuration.push_back(option);
  }
  const auto find = [&configuration](const std::string& name) {
    return std::find_if(configuration.begin(), configuration.end(), [&](const auto& one) { return one.name == name; });
  };
  const auto steps = find("--steps"), parameter = find("--trainer-steps");
  if (steps != configuration.end() && parameter != configuration.end()) {  // they mean the same, --steps wins
    (options.steps > 0 ? parameter : steps)->origin = (options.steps > 0 ? steps : parameter)->origin;
    steps->value = parameter->value;
  }
  return configuration;
}

std::vector<OptionValue> recorded_configuration(const std::string& folder) {
  const std::string path = folder + "/manifest.json";
  if (!std::filesystem::exists(path))
    throw Error("has no manifest.json", folder, "name the folder of a training, as runs/20260101-120000");
  const auto manifest = parse_json(read_file(path), path);
  std::vector<OptionValue> configuration;
  try {
    for (const auto& [name, value] : manifest.at("options").items())
      configuration.push_back(
          {"--" + name, value.get<std::string>(), manifest.at("origins").value(name, kDefaultOrigin)});
  } catch (const nlohmann::json::exception&) {
    throw Error("does not say what options the run had", path, "runs of older releases have fewer figures there");
  }
  return configuration;
}

std::string configuration_text(const std::vector<OptionValue>& configuration) {
  std::size_t name = 0, value = 1;
  for (const OptionValue& option : configuration) {
    name = std::max(name, option.name.size());
    if (option.value.size() <= kMaxValueWidth) value = std::max(value, option.value.size());
  }
  std::string text;
  for (const OptionValue& option : configuration)
    text += fmt::format("{:<{}}  {:<{}}  {}\n", option.name, name, option.value.empty() ? "-" : one_line(option.value),
                        value, option.origin);
  return text;
}

std::string recommendation_text(const std::map<std::string, double>& recommended) {
  std::string text, line = "      recommends";
  for (const auto& [name, value] : recommended) {
    const std::string one = fmt::format("{} {:.10g}", name, value);
    if (line.size() + one.size() + 2 > kListWidth) {
      text += line + ",\n";
      line = std::string(16, ' ');
    } else if (name != recommended.begin()->first) {
      line += ",";
    }
    line += " " + one;
  }
  return recommended.empty() ? "" : text + line + "\n";
}

}  // namespace citylearn
