// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/run_records.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/exchange/timing.h"
#include "core/files/files.h"
#include "core/util/machine.h"
#include "policy_service/records/report.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

constexpr int kShareOfDisk = 20;  // times as long as the disk took, at least

std::string text_of(const nlohmann::ordered_json& manifest) { return manifest.dump(2) + "\n"; }

}  // namespace

RunRecords::RunRecords(const PolicyServiceOptions& options, Node& node, EnvClient& client)
    : options_(options), node_(node), client_(client), folder_(options.output) {
  prepare_output(options_);
  run_id_ = run_id_for(options_);
  const std::string log = options_.output.empty() ? "" : options_.output + "/episodes.csv";
  episodes_ = std::make_unique<EpisodeLog>(log);
  client_.finished = [this](EnvHandle& env, const msg::EpisodeStat& episode) {
    to_acknowledge_.insert(&env);
    if (episode.run_id() != run_id_)
      episodes_->skip(episode);  // of an earlier run, kept for another recorder
    else if (episodes_->record(episode) && events_ && !episode.evaluation())
      events_->finished(episode);
  };
  client_.begin_recording();
}

void RunRecords::open_training_logs(std::uint64_t updates, std::uint64_t steps, const Parameters& parameters) {
  if (options_.output.empty()) return;
  best_.emplace(checkpoint_folder());
  metrics_ = std::make_unique<MetricsLog>(options_.output + "/metrics.csv", updates);
  events_ = std::make_unique<EventLog>(options_.output + "/tensorboard", steps);
  parameters_ = parameters;
  write_manifest();
}

void RunRecords::write_manifest() { write_file(options_.output + "/manifest.json", text_of(manifest(parameters_))); }

nlohmann::ordered_json RunRecords::manifest(const Parameters& parameters) {
  for (const auto& [id, env] : client_.envs())
    if (env->refusal.empty()) traversals_[env->traversal()] = env->info;
  return manifest_json(options_, parameters, traversals_, node_.middleware_name(), run_id_);
}

void RunRecords::announce(const std::string& learner, std::uint64_t updates, const Parameters& parameters) {
  // Of what is of this host alone, only where the run's files are is announced.
  nlohmann::ordered_json announced = manifest(parameters);
  for (const char* name : {"command", "options"}) announced.erase(name);
  // The folders of a simulated machine have other names in each run, which must be the same to the last byte.
  if (!options_.output.empty() && !Machine::simulated()) {
    std::vector<std::string> names = output_names(options_);
    if (best_) names.push_back(fs::path(best_->path()).lexically_relative(options_.output).string());
    std::error_code none;
    announced["artefacts"] = {{"host", host_name()},
                              {"folder", fs::absolute(options_.output, none).lexically_normal().string()},
                              {"names", names}};
  }
  announcer_ = std::make_unique<RunAnnouncer>(
      node_, RunAnnouncer::Run{options_.agent, learner, options_.seed, run_id_, updates, text_of(announced)});
}

void RunRecords::add(msg::TrainingStat& stat) {
  announcer_->add(stat);
  if (metrics_) metrics_->write(stat);
  if (events_) events_->write(stat);
}

void RunRecords::save_checkpoint(std::uint64_t update, Checkpoint checkpoint) {
  if (options_.output.empty()) return;
  pending_ = Pending{update, std::move(checkpoint)};
  retry_ = {};
  write_pending_checkpoints();
}

void RunRecords::save_evaluated(Checkpoint checkpoint, double spl) {
  if (options_.output.empty()) return;
  evaluated_ = BestCheckpoint::evaluated(std::move(checkpoint), spl);
  retry_ = {};
  write_pending_checkpoints();
}

/// A full disk does not end the training: the last checkpoints are still there, and space may be freed.
void RunRecords::write_pending_checkpoints() {
  if ((!pending_ && !evaluated_) || Clock::now() < retry_) return;
  // Rows of updates that are not computed again must last as long as the checkpoint.
  if (metrics_) metrics_->sync();
  if (events_) events_->sync();
  try {
    if (pending_) {
      write_checkpoint_of_update(checkpoint_folder(), pending_->update, pending_->checkpoint);
      best_->consider(pending_->checkpoint);
      pending_.reset();
    }
    if (evaluated_) {
      create_folder(checkpoint_folder());
      best_->consider(*evaluated_);
      evaluated_.reset();
    }
  } catch (const Error& error) {
    retry_ = Clock::now() + kCommitRetry;
    node_.alarm("checkpoint", std::string(error.what()) + "; those before it are kept");
    return;
  }
  node_.alarm("checkpoint", "");
}

/// Reports what waits in memory until it is on the disk.
void RunRecords::report_problems() {
  node_.alarm("episodes.csv", episodes_->problem());
  if (!metrics_) return;
  if (!metrics_->problem().empty()) metrics_->flush();
  if (!events_->problem().empty()) events_->flush();
  node_.alarm("metrics.csv", metrics_->problem());
  node_.alarm("tensorboard", events_->problem());
}

void RunRecords::handle() {
  if (announcer_) announcer_->handle();
  acknowledge(/*all=*/false);
  write_pending_checkpoints();
  report_problems();
}

void RunRecords::acknowledge(bool all) {
  const Clock::time_point begin = Clock::now();
  if (to_acknowledge_.empty() || (!all && begin < next_acknowledgement_)) return;
  for (EnvHandle* env : to_acknowledge_) {
    env->episodes_missing = episodes_->has_gap(env->id, env->incarnation());
    client_.acknowledge(*env, episodes_->recorded(env->id, env->incarnation()));
  }
  to_acknowledge_.clear();
  const Clock::time_point end = Clock::now();
  next_acknowledgement_ = end + std::max<Clock::duration>(kAcknowledgeGather, kShareOfDisk * (end - begin));
}

void RunRecords::require_all_written() {
  retry_ = {};
  write_pending_checkpoints();
  acknowledge();
  if (evaluated_) throw Error("the best checkpoint could not be written", options_.output, "free some space");
  if (pending_)
    throw Error("the checkpoint of update " + std::to_string(pending_->update) + " could not be written",
                options_.output, "free some space, then continue with --resume");
  if (!episodes_->problem().empty()) throw Error(episodes_->problem());
  if (metrics_) write_manifest();
}

void RunRecords::end() {
  if (announcer_) announcer_->end();
}

}  // namespace citylearn
