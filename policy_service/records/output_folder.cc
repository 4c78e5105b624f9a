// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/output_folder.h"

#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/wall_clock.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/records/episode_log.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRemedy = "choose another --output";

bool exists(const std::string& path) {
  std::error_code none;  // what cannot be looked at cannot be written either, which says more
  return fs::exists(path, none);
}

/// Returns a file that shows that a training used the folder; nothing where none did.
std::optional<std::string> training_in(const std::string& folder) {
  for (const char* name : {"/manifest.json", "/metrics.csv"})
    if (exists(folder + name)) return folder + name;
  return newest_checkpoint(folder + "/checkpoints");
}

/// Returns a file with results of a training or an evaluation; nothing where there is none.
std::optional<std::string> results_in(const std::string& folder) {
  if (exists(folder + "/summary.json")) return folder + "/summary.json";
  if (EpisodeLog::has_rows(folder + "/episodes.csv")) return folder + "/episodes.csv";
  return std::nullopt;
}

/// Removes what this run would write. An evaluation leaves the checkpoints alone, as it may act from one.
void remove_earlier_run(const PolicyServiceOptions& options) {
  for (const std::string& name : output_names(options)) {
    std::error_code error;
    fs::remove_all(options.output + "/" + name, error);
    if (error) throw Error("cannot be removed: " + error.message(), options.output + "/" + name);
  }
}

}  // namespace

std::vector<std::string> output_names(const PolicyServiceOptions& options) {
  std::vector<std::string> names = {"summary.json", "episodes.csv"};
  if (options.mode == "train")
    names.insert(names.end(), {"manifest.json", "metrics.csv", "checkpoints", "tensorboard"});
  return names;
}

void require_no_other_run(const PolicyServiceOptions& options) {
  const bool training = options.mode == "train";
  if (options.overwrite) {
    std::error_code none;
    const fs::path initial = fs::weakly_canonical(options.initial_checkpoint, none);
    if (training && !initial.empty() &&
        initial.parent_path() == fs::weakly_canonical(options.output + "/checkpoints", none))
      throw Error("would be removed by --overwrite", options.initial_checkpoint, kRemedy);
    return;
  }
  const auto trained = training_in(options.output), results = results_in(options.output);
  if (!options.resume && (trained || results))
    throw Error("belongs to an earlier run", trained ? *trained : *results,
                "continue it with --resume, replace it with --overwrite, or choose another --output");
  if (options.resume && training && !trained && results)
    throw Error("belongs to an evaluation, which no training continues", *results, kRemedy);
  if (options.resume && !training && trained)
    throw Error("belongs to a training, which no evaluation continues", *trained, kRemedy);
}

void prepare_output(const PolicyServiceOptions& options) {
  const std::string& folder = options.output;
  if (folder.empty()) return;
  require_no_other_run(options);
  if (options.overwrite) remove_earlier_run(options);
  if (options.mode == "train") create_folder(folder + "/checkpoints", kRemedy);
  std::error_code error;
  for (const std::string& of : {folder, folder + "/checkpoints"})
    for (const auto& entry : fs::directory_iterator(of, error))
      if (entry.path().extension() == ".tmp") fs::remove(entry.path(), error);
}

std::uint64_t folder_identity(const std::string& folder) {
  struct stat about {};
  return ::stat(folder.c_str(), &about) == 0 ? about.st_ino : 0;
}

namespace {

/// Returns the manifest.json of the run that is resumed; null where there is none.
nlohmann::json resumed_manifest(const PolicyServiceOptions& options) {
  const std::string path = options.output + "/manifest.json";
  std::error_code none;
  return options.resume && fs::exists(path, none) ? parse_json_or_null(read_file(path)) : nlohmann::json();
}

}  // namespace

std::uint64_t run_id_for(const PolicyServiceOptions& options) {
  using Json = nlohmann::json;
  const std::uint64_t fresh = microseconds_since_epoch();
  const Json manifest = resumed_manifest(options);
  if (!manifest.is_object()) return fresh;
  const auto job = manifest.find("job");
  if (job == manifest.end() || !job->is_number_unsigned()) return fresh;
  // Manifests of earlier versions say neither.
  if (manifest.value("id", Json(options.node.id)) == options.node.id &&
      manifest.value("folder", Json(folder_identity(options.output))) == folder_identity(options.output))
    return job->get<std::uint64_t>();
  spdlog::info("{}: was copied or written by another service: it goes on as a run of its own", options.output);
  return fresh;
}

std::vector<int> earlier_ranks(const PolicyServiceOptions& options) {
  const nlohmann::json manifest = resumed_manifest(options);
  if (!manifest.is_object()) return {};
  try {
    std::vector<int> ranks = manifest.value("ranks_before", std::vector<int>());
    if (const int last = manifest.value("ranks", 1); last != options.ranks) ranks.push_back(last);
    return ranks;
  } catch (const nlohmann::json::exception&) {
    return {};  // no manifest of ours
  }
}

OutputFolder::OutputFolder(const std::string& folder) {
  if (folder.empty()) return;
  create_folder(folder, kRemedy);
  lock_.emplace(folder + "/.lock",
                Error("another policy_service writes here", folder, "end it, or choose another --output"));
}

}  // namespace citylearn
