// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/report.h"

#include <spdlog/fmt/fmt.h>

#include <Eigen/Core>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/plugin/plugins.h"
#include "core/util/text.h"
#include "core/util/version.h"
#include "policy_service/network/layers/product.h"
#include "policy_service/records/output_folder.h"

namespace citylearn {
namespace {

using Json = nlohmann::ordered_json;

Json score_json(const Score& s) {
  return {{"tasks", s.tasks},   {"completed", s.completed},   {"failed", 1 - s.completed},        {"spl", s.spl},
          {"excess", s.excess}, {"mean_steps", s.mean_steps}, {"shortest_mean", s.shortest_mean}, {"reward", s.reward}};
}

template <class T>
Json or_null(const std::optional<T>& value) {
  return value ? Json(*value) : Json(nullptr);
}

Json best_json(const std::optional<BestCheckpoint::Figures>& best) {
  if (!best) return nullptr;
  return {{"checkpoint", std::string("checkpoints/") + kBestCheckpoint},
          {"update", best->update},
          {"spl", best->spl()},
          {"chosen_by", best->evaluation_spl ? "evaluation" : "training"}};
}

}  // namespace

std::string summary_json(const PolicyServiceOptions& options, const TrainingReport* training,
                         const std::vector<ScoreRow>& rows) {
  Json summary = {{"agent", options.agent}, {"middleware", options.node.middleware.name}, {"seed", options.seed}};
  if (training)
    summary["train"] = {
        {"traversal", training->traversal},
        {"episodes", training->episodes},
        {"steps", training->steps},
        {"wall_s", training->wall},
        {"steps_per_s", training->wall > 0 ? static_cast<double>(training->steps) / training->wall : 0.0},
        {"inference_s", training->inference},
        {"update_s", training->update},
        {"reward", training->reward},
        {"spl", training->spl},
        {"episodes_to_spl95", or_null(training->episodes_to_spl95)},
        {"wall_s_to_spl95", or_null(training->wall_to_spl95)},
        {"policy_lag", training->policy_lag},
        {"dropped", training->dropped},
        {"actors_waited_s", training->waited},
        {"best", best_json(training->best)}};
  summary["evaluate"] = Json::object();
  summary["controls"] = Json::object();
  for (const ScoreRow& row : rows) {
    if (row.policy == options.agent) {
      summary["evaluate"][row.traversal] = score_json(row.score);
    } else {
      summary["controls"][row.policy][row.traversal] = score_json(row.score);
    }
  }
  return summary.dump(2) + "\n";
}

Json manifest_json(const PolicyServiceOptions& options,
                   const std::map<std::string, std::map<std::string, double>>& agent,
                   const std::map<std::string, msg::TraversalInfo>& traversals, const std::string& middleware,
                   std::uint64_t job) {
  std::string vendor;
  for (const auto& [name, help] : list_middlewares())
    if (name == middleware) vendor = help;
  Json data;
  for (const auto& [name, info] : traversals)
    data[name] = {{"dataset", info.dataset().c_str()},
                  {"hash", fmt::format("{:016x}", info.hash())},
                  {"frames", info.frames()},
                  {"features", info.feature_dimension()},
                  {"encoder", info.encoder().c_str()}};
  Json manifest = {
      {"program", "policy_service " + version()},
      {"compiler", __VERSION__},
      {"eigen", std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) + "." +
                    std::to_string(EIGEN_MINOR_VERSION)},
      {"instructions", Eigen::SimdInstructionSetsInUse()},
      {"math", name_of(used_math())},
      {"onednn", onednn_release()},
      {"middleware", middleware},
      {"vendor", vendor},
      {"run", options.node.session},
      {"job", job},
      {"id", options.node.id},
      {"folder", folder_identity(options.output)},
      {"mode", options.mode},
      {"role", options.role},
      {"agent", options.agent},
      {"learner", options.learner},
      {"initial", options.initial_checkpoint},
      {"frozen", options.frozen},
      {"plugins", loaded_plugins()},
      {"seed", options.seed},
      {"train", joined(options.train)},
      {"evaluate", options.evaluate},
      {"first_frame", options.first_frame},
      {"frames", options.frames},
      {"max_steps", options.max_steps},
      {"max_detour", options.max_detour},
      {"goal_radius", options.goal_radius},
      {"curriculum", options.curriculum},
      {"environments", options.environments},
      {"window", options.window},
      {"max_lag", options.max_lag},
      {"lockstep", options.lockstep},
      {"steps", options.steps},
      {"time_limit", options.time_limit},
      {"stop_when", options.stop_when},
      {"checkpoint_every", options.checkpoint_every},
      {"tasks", options.tasks},
      {"controls", options.controls},
      {"parameters", agent},
      {"traversals", data},
      {"source", options.source},
  };
  Json values = Json::object(), origins = Json::object();
  for (const OptionValue& option : options.configuration) {
    const std::string name = option.name.substr(option.name.find_first_not_of('-'));
    values[name] = option.value;
    if (option.origin != kDefaultOrigin) origins[name] = option.origin;
  }
  // What the traversals made of them.
  values["frames"] = fmt::format("{}:{}", options.first_frame, options.first_frame + options.frames);
  values["max-steps"] = std::to_string(options.max_steps);
  values["max-detour"] = std::to_string(std::max(options.max_detour, 0));
  if (const auto trainer = agent.find("trainer"); trainer != agent.end())
    for (const auto& [name, value] : trainer->second) values["trainer-" + name] = fmt::format("{:.10g}", value);
  manifest["origins"] = origins;
  std::error_code none;
  if (!options.command.empty()) {
    manifest["command"] = {{"words", options.command}, {"folder", std::filesystem::current_path(none).string()}};
    manifest["options"] = values;
  }
  if (options.ranks_domain) {
    manifest["rank"] = options.rank;
    manifest["ranks"] = options.ranks;
    manifest["sync"] = options.sync;
    manifest["ranks_before"] = options.ranks_before;
  }
  return manifest;
}

}  // namespace citylearn
