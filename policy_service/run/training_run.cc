// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/training_run.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/exchange/timing.h"
#include "core/files/json.h"
#include "core/util/version.h"
#include "core/wire/service.h"
#include "policy_service/ranks/gloo_group.h"

namespace citylearn {
namespace {

/// Adds the time of its life to `seconds`.
class Stopwatch {
 public:
  explicit Stopwatch(double& seconds) : seconds_(seconds) {}
  ~Stopwatch() { seconds_ += seconds_since(start_); }
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;

 private:
  double& seconds_;
  Clock::time_point start_ = Clock::now();
};

}  // namespace

void TrainingRun::build_trainer() {
  const PolicyServiceOptions& options = context_.options;
  Matrix<float> reference;
  do {
    context_.wait_for_training_envs(options.environments);
    context_.fit_route(context_.training_envs());
    reference = context_.reference();  // refuses env_services that do not deliver theirs
    learned_ = {{}, options.source};
    for (const std::string& traversal : options.train)
      if (const EnvHandle* env = context_.env_on(traversal)) learned_.traversals.push_back(contents_of(env->info));
  } while (learned_.traversals.size() < options.train.size() ||
           (reference.size() == 0 && learned_.traversals.front().feature_dimension > 0));
  TrainerOptions trainer = options;
  if (options.steps > 0) trainer.trainer_parameters["steps"] = static_cast<double>(options.steps);
  NetworkTask task;
  task.frames = options.frames;
  task.features = static_cast<int>(learned_.traversals.front().feature_dimension);
  task.streets = context_.streets_on(options.train.front());
  task.goal_radius = options.goal_radius;
  context_.require(task.features, learned_);
  task.reference = std::move(reference);
  const std::string folder = context_.records.checkpoint_folder();
  const std::optional<std::string> newest = options.resume ? newest_checkpoint(folder) : std::nullopt;
  if (!options.initial_checkpoint.empty() && !newest) {
    trainer.initial = unbuilt_agent(read_checkpoint(options.initial_checkpoint));
    trainer.initial->build_network(trainer.initial->places > 0 ? task : trainer.initial->task);
    const TraversalContents& first = learned_.traversals.front();
    for (const TraversalContents& before : trainer.initial->data.traversals)
      if (const std::string wrong = features_misfit(first, before, "'" + before.traversal + "'"); !wrong.empty())
        spdlog::warn("{}: its agent saw other features: '{}' {}", options.initial_checkpoint, first.traversal, wrong);
  }
  trainer_ = std::make_unique<Trainer>(trainer, task);
  if (trainer.initial)
    spdlog::info("starting from the agent of {} (its update {})", options.initial_checkpoint, trainer.initial->update);
  if (!trainer_->frozen().empty()) spdlog::info("frozen tensors: {}", fmt::join(trainer_->frozen(), ", "));
  if (newest) {
    trainer_->load(read_checkpoint(*newest));
    saved_ = trainer_->progress().updates;
    spdlog::info("resuming after update {} ({} steps) of {}", trainer_->progress().updates, trainer_->progress().steps,
                 *newest);
  } else if (options.resume) {
    spdlog::info("no checkpoint in {}: starting anew", folder);
  }
  if (options.ranks_domain) join_ranks();
  const TrainingProgress& progress = trainer_->progress();
  context_.records.open_training_logs(progress.updates, progress.steps, trainer_->parameters());
  if (const BestCheckpoint* best = context_.records.best();
      best && best->figures() && best->figures()->lesson == progress.lesson)
    watch_ = CollapseWatch(best->figures()->training_spl.value_or(0));
  earlier_wall_ = context_.records.earlier_wall();
  if (!options.output.empty()) report_.episodes_to_spl95 = progress.episodes_to_spl95;
  if (report_.episodes_to_spl95) report_.wall_to_spl95 = context_.records.earlier_wall_at(*report_.episodes_to_spl95);
  context_.records.announce(options.learner, progress.updates, trainer_->parameters());
}

/// Waits for the other ranks and continues from where they are.
void TrainingRun::join_ranks() {
  PolicyServiceOptions& options = context_.options;
  options.ranks_before = earlier_ranks(options);
  if (!options.ranks_before.empty())
    spdlog::info("{} ranks go on where {} were", options.ranks, options.ranks_before.back());
  nlohmann::json traversals = nlohmann::json::object();
  for (const TraversalContents& contents : learned_.traversals)
    traversals[contents.traversal] = {{"hash", fmt::format("{:016x}", contents.hash)},
                                      {"encoder", contents.encoder.value_or("")}};
  RankOptions ranks;
  ranks.rank = options.rank;
  ranks.ranks = options.ranks;
  ranks.node = options.node;
  ranks.node.middleware.domain = *options.ranks_domain;
  ranks.patience = std::chrono::milliseconds(static_cast<std::int64_t>(1000 * options.ranks_wait));
  ranks.identity = nlohmann::json{
      {"program", version()},
      {"training", parse_json(trainer_->identity(), "identity")},
      {"traversals", traversals},
      {"initial", options.initial_checkpoint},
      {"checkpoint-every", options.checkpoint_every},
      {"time-limit", options.time_limit},
      {"stop-when", options.stop_when},
      {"lockstep", options.lockstep},
      {"sync",
       options.sync}}.dump();
  ranks_ = std::make_unique<GlooGroup>(ranks, [] {
    if (stop_requested()) throw StopRequested();
  });
  sharing_ = std::make_unique<SharedUpdates>(*ranks_, options.sync == "step");
  context_.node.report(msg::WAITING, "waiting for the other ranks");
  spdlog::info("rank {} of {} waits for the others in domain {}", options.rank, options.ranks, *options.ranks_domain);
  HeartbeatThread heartbeat(context_.node);
  heartbeat.run([this] {
    trainer_->share_updates(*sharing_);
    return true;
  });
  spdlog::info("{} ranks learn together from update {} on", sharing_->members(), trainer_->progress().updates);
}

/// Adds what the agent learns from.
Checkpoint TrainingRun::with_data(Checkpoint checkpoint) const {
  checkpoint.header["data"] = parse_json(learned_.text(), "data");
  return checkpoint;
}

void TrainingRun::save(Checkpoint checkpoint) {
  if (sharing_ && !sharing_->lowest()) return;
  saved_ = trainer_->progress().updates;
  context_.records.save_checkpoint(*saved_, with_data(std::move(checkpoint)));
}

/// A training that had ended already keeps its checkpoint, byte for byte.
void TrainingRun::save_newest() {
  if (trainer_->progress().updates > saved_.value_or(0)) save(trainer_->checkpoint());
}

bool TrainingRun::update(const std::function<UpdateFigures()>& learn) {
  const std::uint64_t steps_before = trainer_->progress().steps;
  UpdateFigures figures;
  {
    const Stopwatch watch(report_.update);
    trainer_->set_progress(elapsed_fraction());
    figures = learn();
  }
  record_update(figures, steps_before);
  warn_of_collapse();
  if (ended() || time_is_up()) return false;
  const std::uint64_t updates = trainer_->progress().updates;
  const auto due = [updates](int every) { return every > 0 && updates % static_cast<std::uint64_t>(every) == 0; };
  if (due(context_.options.checkpoint_every)) save(trainer_->checkpoint());
  if (due(context_.options.evaluate_every)) {
    evaluation_.set_agent(trainer_->agent());
    const std::optional<double> spl = evaluate_others();
    if (spl && (!sharing_ || sharing_->lowest()))
      context_.records.save_evaluated(with_data(trainer_->snapshot()), *spl);
  }
  return true;
}

bool TrainingRun::ended() const {
  const TrainingProgress& progress = trainer_->progress();
  const double wanted = context_.options.stop_when;
  return trainer_->done() || (wanted > 0 && trainer_->settled() && progress.spl >= wanted);
}

/// Warns while the agent is much worse than it was.
void TrainingRun::warn_of_collapse() {
  const TrainingProgress& progress = trainer_->progress();
  if (!trainer_->settled()) return;
  if (const bool before = std::exchange(collapsed_, watch_.collapsed(progress.spl)); before == collapsed_) return;
  std::string problem;
  if (collapsed_) {
    const BestCheckpoint* best = context_.records.best();
    problem =
        fmt::format("SPL fell from {:.3f} to {:.3f} at update {}; ", watch_.best(), progress.spl, progress.updates) +
        (best && best->figures() ? fmt::format("{} is of {}", best->path(), best->figures()->description())
                                 : "no checkpoint has kept the best agent");
  }
  context_.node.alarm("training", problem);
}

void TrainingRun::record_update(const UpdateFigures& figures, std::uint64_t steps_before) {
  const PolicyServiceOptions& options = context_.options;
  const TrainingProgress& progress = trainer_->progress();
  const double wall = this->wall();
  const double rate = static_cast<double>(progress.steps - steps_before) / std::max(1e-9, seconds_since(last_update_));
  last_update_ = Clock::now();
  msg::TrainingStat stat;
  stat.update() = progress.updates;
  stat.steps() = progress.steps;
  stat.episodes() = progress.episodes;
  stat.lesson() = static_cast<std::uint32_t>(progress.lesson);
  stat.wall() = wall;
  stat.steps_per_second() = static_cast<float>(rate);
  stat.reward() = static_cast<float>(progress.reward);
  stat.spl() = static_cast<float>(progress.spl);
  stat.episode_length() = static_cast<float>(progress.episode_length);
#define LEARNED(name, ...) stat.name() = static_cast<float>(figures.name);
#include "core/task/training_figures.inc"
  stat.policy_lag() = static_cast<float>(policy_lag());
  report_.policy_lag += (stat.policy_lag() - report_.policy_lag) / static_cast<double>(++report_.updates);
  context_.records.add(stat);
  if (!report_.episodes_to_spl95 && progress.episodes_to_spl95) {
    report_.episodes_to_spl95 = progress.episodes_to_spl95;
    report_.wall_to_spl95 = wall;
  }
  const double done =
      std::max(static_cast<double>(progress.steps) / static_cast<double>(trainer_->total_steps()), elapsed_fraction());
  context_.node.report(msg::RUNNING, fmt::format("training {}, update {}", options.agent, progress.updates),
                       static_cast<float>(rate));
  const double left = done > 0.01 ? wall * (1 - done) / done : -1;
  context_.progress.show(
      "training " + options.agent, done, static_cast<double>(progress.steps) / std::max(wall, 1e-9), left,
      fmt::format("{}{}{}",
                  std::isnan(progress.spl) ? "no episode has ended yet"
                                           : fmt::format("reward {:.3f}  SPL {:.3f}", progress.reward, progress.spl),
                  options.curriculum ? fmt::format("  lesson {}", progress.lesson + 1) : "", actors_note()));
}

void TrainingRun::execute() {
  const PolicyServiceOptions& options = context_.options;
  context_.require();
  build_trainer();
  const std::string names = joined(options.train);
  spdlog::info("training {} on '{}': {} steps, seed {}, {}", options.agent, names, trainer_->total_steps(),
               options.seed, context_.node.middleware_name());
  since_ = last_update_ = Clock::now();
  try {
    train();
  } catch (const StopRequested&) {
    // In lockstep, what is resumed must be what was not interrupted, whose checkpoints are due at fixed updates.
    if (!options.lockstep) save_newest();
    throw;
  }
  if (ranks_) ranks_->leave();
  context_.progress.finish();
  const TrainingProgress& progress = trainer_->progress();
  report_.traversal = names;
  report_.episodes = progress.episodes;
  report_.steps = progress.steps;
  if (report_.wall == 0) report_.wall = wall();
  report_.reward = progress.reward;
  report_.spl = progress.spl;
  save_newest();
  if (const BestCheckpoint* best = context_.records.best()) report_.best = best->figures();
  evaluation_.set_agent(trainer_->agent());
  constexpr double kMargin = 0.02;
  if (const BestCheckpoint* best = context_.records.best();
      best && best->figures() && (best->figures()->evaluation_spl || best->figures()->spl() > progress.spl + kMargin))
    spdlog::info("the best checkpoint is of {}: {}", best->figures()->description(), best->path());
  const double here = std::max(seconds_since(since_), 1e-9);
  spdlog::info(
      "trained {} episodes, {} steps in {:.1f} s ({:.0f} steps/s): {:.0f} % inference, {:.0f} % update, {:.0f} % "
      "waiting for environments and transport",
      report_.episodes, report_.steps, report_.wall, static_cast<double>(report_.steps) / std::max(report_.wall, 1e-9),
      100 * report_.inference / here, 100 * report_.update / here,
      100 * std::max(0.0, 1 - (report_.inference + report_.update) / here));
}

/// Begins a training environment anew: at the start, after a restart of its process, and with each generation.
void LocalTrainingRun::enroll(EnvHandle& env) {
  const int slot = slots_.emplace(&env, static_cast<int>(slots_.size())).first->second;
  trainer_->add(slot, static_cast<int>(env.info.agents()), context_.experience_on(env.traversal()));
  active_.insert(&env);
  msg::TaskSettings settings;
  trainer_->settings(slot, settings);
  settings.run_id() = context_.records.run_id();
  context_.client.command(env, settings);
}

void LocalTrainingRun::drop(EnvHandle& env) {
  trainer_->remove(slots_.at(&env));
  active_.erase(&env);
}

void LocalTrainingRun::drop_lost_envs() {
  std::vector<EnvHandle*> silent;
  for (EnvHandle* env : std::set<EnvHandle*, ById>(active_)) {
    if (!env->refusal.empty()) {
      spdlog::warn("training goes on without env_service '{}'", env->id);
      drop(*env);
    } else if (!env->alive() || env->lost()) {
      silent.push_back(env);
    }
  }
  if (silent.size() < active_.size()) {
    if (context_.options.lockstep) return;
    for (EnvHandle* env : silent) {
      spdlog::warn("env_service '{}' {}: training goes on without it", env->id,
                   env->alive() ? "works for another policy_service" : "went silent");
      drop(*env);
      env->release();
    }
    return;
  }
  // None is left to continue with.
  context_.wait_for_training_envs(1);
  for (EnvHandle* env : context_.training_envs())
    if (!active_.contains(env) || env->lost()) enroll(*env);
}

void LocalTrainingRun::train() {
  EnvClient& client = context_.client;
  // One of them may have fallen silent while its features were fetched.
  context_.wait_for_training_envs(context_.options.environments);
  client.joined = [this](EnvHandle& env) {
    if (context_.experience_on(env.traversal()) >= 0) enroll(env);
  };
  client.decide = [this](EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
    const Stopwatch watch(report_.inference);
    return active_.contains(&env) && trainer_->act(slots_.at(&env), observation, choice);
  };
  client.believe = [this](EnvHandle& env, msg::Belief& belief) { trainer_->believe(slots_.at(&env), belief); };
  for (EnvHandle* env : context_.training_envs()) enroll(*env);
  train_on();
  client.joined = nullptr;
  client.believe = nullptr;
  client.decide = nullptr;
}

void LocalTrainingRun::train_on() {
  std::vector<std::uint8_t> choice;
  while (!ended()) {
    context_.spin();
    drop_lost_envs();
    if (!trainer_->ready()) continue;
    const std::uint64_t generation_before = trainer_->generation();
    if (!update([this] { return heartbeat_.run([this] { return trainer_->update(); }); })) return;
    // After a checkpoint or at a new lesson all begin anew (docs/decisions/0003-step-protocol.md), else all continue.
    for (EnvHandle* env : std::set<EnvHandle*, ById>(active_)) {
      if (trainer_->generation() != generation_before) {
        enroll(*env);
      } else if (env->waiting) {
        {
          const Stopwatch watch(report_.inference);
          trainer_->resume(slots_.at(env), choice);
        }
        context_.client.answer(*env, choice);
      }
    }
  }
}

// The learner's side.

std::string LearnerRun::actors_note() const {
  return fmt::format("  {} actors, lag {:.1f}", server_->actors(), report_.policy_lag);
}

std::optional<double> LearnerRun::evaluate_others() {
  context_.client.receive_observations(true);
  const std::optional<double> spl = TrainingRun::evaluate_others();
  context_.client.receive_observations(false);
  return spl;
}

void LearnerRun::train() {
  LearnerServerOptions options;
  options.learned = learned_.traversals.front();
  options.window = context_.options.window;
  options.max_lag = context_.options.max_lag;
  options.run_id = context_.records.run_id();
  server_ = std::make_unique<LearnerServer>(context_.node, context_.client, *trainer_, options);
  context_.on_spin = [this] { server_->handle(); };
  context_.client.receive_observations(false);
  Clock::time_point next_log = Clock::now() + std::chrono::seconds(5);
  while (!ended()) {
    context_.spin();
    if (server_->ready()) {
      if (!update([this] { return server_->learn(); })) break;
      warn_of_lag();
      continue;
    }
    if (server_->actors() == 0) {
      context_.node.report(msg::WAITING, "waiting for actors");
      if (Clock::now() > next_log) spdlog::info("waiting for actors (policy_service --role actor)");
    }
    if (server_->actors() > 0 || Clock::now() > next_log) next_log = Clock::now() + std::chrono::seconds(10);
  }
  report_.wall = wall();
  dismiss_actors();
  report_.dropped = server_->dropped();
  report_.waited = server_->waited();
  spdlog::info("mean policy lag {:.2f} updates, {} trajectories were too old, actors waited {:.1f} s for room",
               report_.policy_lag, report_.dropped, report_.waited);
}

/// Says once when actors collect much more than updates take, as the agent then learns from what it did long ago.
void LearnerRun::warn_of_lag() {
  constexpr int kMinUpdates = 20;       // updates
  constexpr double kMaxPolicyLag = 16;  // updates
  if (warned_of_lag_ || report_.updates < kMinUpdates || report_.policy_lag < kMaxPolicyLag) return;
  warned_of_lag_ = true;
  spdlog::warn(
      "the agent learns from steps of parameters {:.0f} updates ago: actors have more agents than the {} trajectories "
      "of "
      "an update. Raise --trainer-agents, or drop old trajectories with --max-lag",
      report_.policy_lag, trainer_->batch());
}

void LearnerRun::dismiss_actors() {
  server_->end();
  const Clock::time_point deadline = Clock::now() + kDismiss;
  while (!server_->released() && Clock::now() < deadline) context_.spin();
  context_.client.receive_observations(true);
}

}  // namespace citylearn
