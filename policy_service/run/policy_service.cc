// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/policy_service.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <optional>
#include <set>

#include "core/util/files.h"
#include "core/wire/service.h"
#include "policy_service/distributed/actor.h"
#include "policy_service/distributed/env_client.h"
#include "policy_service/distributed/final_status_guard.h"
#include "policy_service/distributed/heartbeat_thread.h"
#include "policy_service/distributed/learner_server.h"
#include "policy_service/interchange/event_log.h"
#include "policy_service/interchange/safetensors.h"
#include "policy_service/learning/trainer.h"
#include "policy_service/network/checkpoint.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/network_policy.h"
#include "policy_service/run/episode_log.h"
#include "policy_service/run/evaluation.h"
#include "policy_service/run/metrics_log.h"
#include "policy_service/run/progress.h"
#include "policy_service/run/report.h"
#include "policy_service/run/run_record.h"
#include "policy_service/run/score.h"

namespace citylearn {
namespace {

// Purposes of random streams: (seed, purpose, ...) names a stream.
enum : std::uint64_t { kEvaluationTasks = 102, kEvaluationChoices = 103 };

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

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

/// Thrown to leave whatever is going on when a signal asks the service to stop.
struct Stopped {};

class Run {
 public:
  Run(const PolicyServiceOptions& options, Node& node, Fleet& fleet);
  ~Run() { fleet_.decide = nullptr, fleet_.finished = nullptr, fleet_.joined = nullptr; }
  int execute();

 private:
  void spin();
  void acknowledge();
  void await(const std::set<std::string>& traversals, int training_environments);
  std::vector<Seat*> seats_on(const std::string& traversal) const;
  Seat* seat_on(const std::string& traversal) const;
  std::vector<Seat*> evaluation_seats();

  void build_trainer();
  void train();
  void train_until_done();
  void learn_until_done();
  void enroll(Seat& seat);
  void drop_lost_seats();
  void after_update(const UpdateFigures& figures, std::uint64_t steps_before);
  void evaluate_others();
  void save_checkpoint();
  void write_unsaved();
  void tell_of_files();
  double training_wall() const { return wall_before_ + seconds_since(training_since_); }
  /// Share of --time-limit.
  double time_over() const { return options_.time_limit > 0 ? training_wall() / options_.time_limit : 0; }
  std::string checkpoints() const { return options_.output + "/checkpoints"; }
  std::map<std::string, msg::TraversalInfo> traversals() const;

  void load_agent();
  void evaluate_all();
  void evaluate(const std::string& name, bool shuffle, const Evaluation::MakePolicy& make,
                const std::vector<Seat*>& seats);
  Evaluation::MakePolicy agent_policy() const;
  const std::vector<float>& reference();
  std::string manifest() const;
  void begin_record();
  void require_all_written();
  void write_summary();
  void leave();

  PolicyServiceOptions options_;
  bool control_alone_ = false;  ///< mode evaluate without a checkpoint: the agent is a control
  Node& node_;
  Heart heart_;
  Fleet& fleet_;
  std::uint64_t job_ = 0;              ///< names this run; kept when it is resumed
  std::unique_ptr<RunRecord> record_;  ///< once all is known that it tells
  std::unique_ptr<EpisodeLog> episodes_;
  std::unique_ptr<MetricsLog> metrics_;
  std::unique_ptr<EventLog> events_;
  /// A checkpoint that the disk did not take, and when it is tried again.
  struct Unsaved {
    std::uint64_t update = 0;
    Checkpoint checkpoint;
    Clock::time_point again{};
  };
  std::optional<Unsaved> unsaved_;
  Progress progress_;
  std::set<Seat*> to_acknowledge_;
  std::unique_ptr<Trainer> trainer_;
  std::optional<TrainedAgent> agent_;
  std::map<const Seat*, int> slots_;   ///< number of each training environment, which names its random streams
  std::set<Seat*> taking_part_;        ///< training environments that are not lost
  std::unique_ptr<LearnerLink> link_;  ///< role learner, once there is something to tell actors
  Clock::time_point training_since_, last_update_;
  double wall_before_ = 0;
  TrainingReport report_;
  std::vector<ScoreRow> rows_;
  std::vector<float> reference_;
};

Run::Run(const PolicyServiceOptions& options, Node& node, Fleet& fleet)
    : options_(options), node_(node), heart_(node), fleet_(fleet) {
  control_alone_ = options_.mode == "evaluate" && options_.checkpoint.empty();
  if (!options_.output.empty()) {
    // Neither is it overwritten, nor may a later --resume take its checkpoints for this run's.
    if (const auto earlier = newest_checkpoint(checkpoints()); earlier && options_.mode == "train" && !options_.resume)
      throw Error("is of an earlier run", *earlier, "go on with it by --resume, or choose another --output");
    std::error_code error;
    std::filesystem::create_directories(options_.output + "/checkpoints", error);
    if (error) throw Error(error.message(), options_.output, "choose another --output");
    // What a process that was killed had begun to write.
    for (const std::string& folder : {options_.output, checkpoints()})
      for (const auto& entry : std::filesystem::directory_iterator(folder, error))
        if (entry.path().extension() == ".tmp") std::filesystem::remove(entry.path(), error);
  }
  job_ = options_.resume ? job_of(options_.output + "/manifest.json") : new_job();
  const std::string log = options_.output.empty() ? "" : options_.output + "/episodes.csv";
  if (!options_.resume && !log.empty()) std::filesystem::remove(log);
  episodes_ = std::make_unique<EpisodeLog>(log);
  fleet_.finished = [this](Seat& seat, const msg::EpisodeStat& episode) {
    to_acknowledge_.insert(&seat);
    if (episode.run_id() != job_)
      episodes_->pass_over(episode);  // of a run before this one, kept for somebody else
    else if (episodes_->record(episode) && events_ && !episode.evaluation())
      events_->finished(episode);
  };
  fleet_.begin_recording();
}

/// Everything waits here: messages, acknowledgements, signals.
void Run::spin() {
  fleet_.spin(Clock::now() + std::chrono::milliseconds(50));
  if (link_) link_->handle();
  if (record_) record_->handle();
  acknowledge();
  write_unsaved();
  tell_of_files();
  if (stop_requested()) throw Stopped();
}

void Run::acknowledge() {
  for (Seat* seat : to_acknowledge_) fleet_.acknowledge(*seat, episodes_->recorded(seat->id, seat->incarnation()));
  to_acknowledge_.clear();
}

std::vector<Seat*> Run::seats_on(const std::string& traversal) const {
  std::vector<Seat*> found;
  for (const auto& [id, seat] : fleet_.seats())
    if (seat->traversal() == traversal && Fleet::alive(*seat)) found.push_back(seat.get());
  return found;
}

Seat* Run::seat_on(const std::string& traversal) const {
  const std::vector<Seat*> found = seats_on(traversal);
  return found.empty() ? nullptr : found.front();
}

std::map<std::string, msg::TraversalInfo> Run::traversals() const {
  std::map<std::string, msg::TraversalInfo> found;
  for (const auto& [id, seat] : fleet_.seats()) found[seat->traversal()] = seat->info;
  return found;
}

void Run::await(const std::set<std::string>& traversals, int training_environments) {
  Clock::time_point since = Clock::now(), next_word = since + std::chrono::seconds(5);
  while (true) {
    std::string missing;
    for (const std::string& traversal : traversals) {
      const int wanted = traversal == options_.train ? training_environments : 1;
      const int found = static_cast<int>(seats_on(traversal).size());
      if (found >= wanted) continue;
      missing += (missing.empty() ? "" : ", ") + traversal;
      if (wanted > 1) missing += fmt::format(" ({} of {})", found, wanted);
    }
    if (missing.empty()) return;
    // A foreign type on our topics will not go away by waiting.
    if (!node_.faults().empty() && Clock::now() - since > std::chrono::seconds(3))
      throw Error("no env_service on " + missing + "; " + node_.faults().front());
    std::string here;
    for (const auto& [id, seat] : fleet_.seats()) here += (here.empty() ? "" : ", ") + id + " on " + seat->traversal();
    const auto unencoded = fleet_.unencoded();
    const auto encoders = fleet_.encoders();
    const bool encoding = !unencoded.empty() && std::any_of(encoders.begin(), encoders.end(),
                                                            [](const auto& encoder) { return encoder.working; });
    for (const auto& [id, traversal] : unencoded)
      here += (here.empty() ? "" : ", ") + id + " on " + traversal +
              (encoding ? ", being encoded" : ", whose images wait for an encoder_service");
    std::string found = here.empty() ? "none was found" : "found: " + here;
    for (const auto& encoder : encoders)
      if (!unencoded.empty() && !encoder.working) found += "; " + encoder.says;
    // Encoding takes its time, and tells how far it is.
    if (encoding) since = Clock::now();
    if (options_.wait > 0 && seconds_since(since) > options_.wait)
      throw Error(fmt::format("no env_service on {} within {:.0f} s ({})", missing, options_.wait, found), "",
                  fmt::format("same --session '{}', --domain {} and --interface there?", options_.node.session,
                              options_.node.middleware.domain));
    if (Clock::now() > next_word) {
      if (!encoding) spdlog::info("waiting for env_services on {} ({})", missing, found);
      for (const auto& encoder : encoders)
        if (encoding && encoder.working) spdlog::info("waiting for {}", encoder.says);
      next_word += std::chrono::seconds(10);
    }
    node_.report(msg::WAITING, "waiting for env_services");
    spin();
  }
}

// ---------------------------------------------------------------------------------------------------- training

void Run::build_trainer() {
  Seat& first = *seat_on(options_.train);
  TrainerOptions trainer;
  trainer.agent = options_.agent;
  trainer.learner = options_.learner;
  trainer.network_parameters = options_.network_parameters;
  trainer.learner_parameters = options_.learner_parameters;
  trainer.trainer_parameters = options_.trainer_parameters;
  if (options_.steps > 0) trainer.trainer_parameters["steps"] = static_cast<double>(options_.steps);
  trainer.seed = options_.seed;
  trainer.first_frame = options_.first_frame;
  trainer.max_steps = options_.max_steps;
  trainer.curriculum = options_.curriculum;
  NetworkTask task;
  task.frames = options_.frames;
  task.features = static_cast<int>(first.info.feature_dimension());
  const std::vector<float>& features = reference();
  if (!features.empty())
    task.reference = Eigen::Map<const Matrix<float>>(features.data(), task.features, options_.frames);
  trainer.frozen = options_.frozen;
  const std::optional<std::string> newest = options_.resume ? newest_checkpoint(checkpoints()) : std::nullopt;
  if (!options_.initial.empty() && !newest) trainer.initial = trained_agent(read_checkpoint(options_.initial));
  trainer_ = std::make_unique<Trainer>(trainer, task);
  if (trainer.initial)
    spdlog::info("beginning with the agent of {} (its update {})", options_.initial, trainer.initial->update);
  if (!trainer_->frozen().empty()) spdlog::info("these stay as they are: {}", fmt::join(trainer_->frozen(), ", "));
  if (options_.resume) {
    if (newest) {
      trainer_->load(read_checkpoint(*newest));
      spdlog::info("going on after update {} ({} steps) of {}", trainer_->progress().updates,
                   trainer_->progress().steps, *newest);
    } else {
      spdlog::info("no checkpoint in {}: beginning", checkpoints());
    }
  }
  if (!options_.output.empty()) {
    metrics_ = std::make_unique<MetricsLog>(options_.output + "/metrics.csv", trainer_->progress().updates);
    events_ = std::make_unique<EventLog>(options_.output + "/tensorboard", trainer_->progress().steps);
    wall_before_ = metrics_->wall();
    if ((report_.episodes_to_spl95 = trainer_->progress().episodes_to_spl95))
      report_.wall_to_spl95 = metrics_->wall_at(*report_.episodes_to_spl95);
    write_file(options_.output + "/manifest.json", manifest());
  }
  begin_record();
}

std::string Run::manifest() const {
  return manifest_json(options_,
                       trainer_ ? trainer_->parameters() : std::map<std::string, std::map<std::string, double>>(),
                       traversals(), node_.middleware_name(), job_);
}

void Run::begin_record() {
  RunRecord::What what;
  what.agent = options_.agent;
  if (trainer_) what.learner = options_.learner;
  what.seed = options_.seed;
  what.job = job_;
  what.updates = trainer_ ? trainer_->progress().updates : 0;
  what.manifest = manifest();
  record_ = std::make_unique<RunRecord>(node_, what);
}

/// A training environment begins anew: at the start, after a restart of its process, and at each cut.
void Run::enroll(Seat& seat) {
  const int slot = slots_.emplace(&seat, static_cast<int>(slots_.size())).first->second;
  trainer_->add(slot, static_cast<int>(seat.info.agents()));
  taking_part_.insert(&seat);
  msg::TaskSettings settings;
  trainer_->settings(slot, settings);
  settings.run_id() = job_;
  fleet_.command(seat, settings);
}

void Run::drop_lost_seats() {
  if (options_.lockstep) return;
  std::vector<Seat*> lost;
  for (Seat* seat : taking_part_)
    if (!Fleet::alive(*seat)) lost.push_back(seat);
  if (lost.size() == taking_part_.size()) return;  // nobody to go on with
  for (Seat* seat : lost) {
    spdlog::warn("env_service '{}' went silent: training goes on without it", seat->id);
    trainer_->remove(slots_.at(seat));
    taking_part_.erase(seat);
  }
}

void Run::save_checkpoint() {
  Checkpoint checkpoint = trainer_->checkpoint();
  if (options_.output.empty()) return;
  unsaved_ = Unsaved{trainer_->progress().updates, std::move(checkpoint)};
  write_unsaved();
}

/// A full disk must not end the training: the last checkpoints are still there, and the disk may be emptied.
void Run::write_unsaved() {
  if (!unsaved_ || Clock::now() < unsaved_->again) return;
  try {
    write_checkpoint_of_update(checkpoints(), unsaved_->update, unsaved_->checkpoint);
  } catch (const Error& error) {
    unsaved_->again = Clock::now() + std::chrono::seconds(1);
    node_.alarm("checkpoint", std::string(error.what()) + "; those before it are kept");
    return;
  }
  unsaved_.reset();
  node_.alarm("checkpoint", "");
}

/// What could not be written waits in memory; whoever watches hears of it until it is on the disk.
void Run::tell_of_files() {
  node_.alarm("episodes.csv", episodes_->problem());
  if (!metrics_) return;
  if (!metrics_->problem().empty()) metrics_->flush();
  if (!events_->problem().empty()) events_->flush();
  node_.alarm("metrics.csv", metrics_->problem());
  node_.alarm("tensorboard", events_->problem());
}

void Run::after_update(const UpdateFigures& figures, std::uint64_t steps_before) {
  const TrainingProgress& progress = trainer_->progress();
  const double wall = training_wall();
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
  stat.policy_loss() = static_cast<float>(figures.policy_loss);
  stat.value_loss() = static_cast<float>(figures.value_loss);
  stat.entropy() = static_cast<float>(figures.entropy);
  stat.divergence() = static_cast<float>(figures.divergence);
  stat.clipped() = static_cast<float>(figures.clipped);
  stat.gradient_norm() = static_cast<float>(figures.gradient_norm);
  stat.learning_rate() = static_cast<float>(figures.learning_rate);
  stat.lag() = static_cast<float>(link_ ? link_->lag() : 0);
  report_.lag += (stat.lag() - report_.lag) / static_cast<double>(++report_.updates);
  record_->add(stat);
  if (metrics_) metrics_->write(stat);
  if (events_) events_->write(stat);
  if (!report_.episodes_to_spl95 && progress.episodes_to_spl95) {
    report_.episodes_to_spl95 = progress.episodes_to_spl95;
    report_.wall_to_spl95 = wall;
  }
  const double share =
      std::max(static_cast<double>(progress.steps) / static_cast<double>(trainer_->total_steps()), time_over());
  node_.report(msg::RUNNING, fmt::format("training {}, update {}", options_.agent, progress.updates),
               static_cast<float>(rate));
  const double left = share > 0.01 ? wall * (1 - share) / share : -1;
  progress_.show("training " + options_.agent, share, static_cast<double>(progress.steps) / std::max(wall, 1e-9), left,
                 fmt::format("reward {:.3f}  SPL {:.3f}{}{}", progress.reward, progress.spl,
                             options_.curriculum ? fmt::format("  lesson {}", progress.lesson + 1) : "",
                             link_ ? fmt::format("  {} actors, lag {:.1f}", link_->actors(), report_.lag) : ""));
}

/// Between two updates; the training environments wait meanwhile, so what they do is the same with and without it.
void Run::evaluate_others() {
  std::vector<Seat*> others;
  for (Seat* seat : evaluation_seats())
    if (seat->traversal() != options_.train) others.push_back(seat);
  if (others.empty()) return;
  agent_ = trainer_->agent();
  evaluate(options_.agent, false, agent_policy(), others);
  for (const ScoreRow& row : rows_)
    spdlog::info("update {} on '{}': completed {:.1f} %, SPL {:.3f}", trainer_->progress().updates, row.traversal,
                 100 * row.score.completed, row.score.spl);
  rows_.clear();
}

/// Updates until all steps are learned from or the time is up.
void Run::train_until_done() {
  std::vector<std::uint8_t> choice;
  while (!trainer_->done()) {
    spin();
    drop_lost_seats();
    if (!trainer_->ready()) continue;
    const std::uint64_t cut_before = trainer_->cut(), steps_before = trainer_->progress().steps;
    UpdateFigures figures;
    {
      const Stopwatch watch(report_.update);
      trainer_->come_to(time_over());
      figures = heart_.beside([this] { return trainer_->update(); });
    }
    after_update(figures, steps_before);
    if (trainer_->done() || time_over() >= 1) return;
    const std::uint64_t updates = trainer_->progress().updates;
    if (updates % static_cast<std::uint64_t>(options_.checkpoint_every) == 0) save_checkpoint();
    if (options_.evaluate_every > 0 && updates % static_cast<std::uint64_t>(options_.evaluate_every) == 0)
      evaluate_others();
    // After a checkpoint or at a new lesson all begin anew (docs/decisions/0003-step-protocol.md), else all go on.
    for (Seat* seat : std::set<Seat*>(taking_part_)) {
      if (trainer_->cut() != cut_before) {
        enroll(*seat);
      } else if (seat->waiting) {
        {
          const Stopwatch watch(report_.inference);
          trainer_->resume(slots_.at(seat), choice);
        }
        fleet_.answer(*seat, choice);
      }
    }
  }
}

/// Role learner: as train_until_done(), from what actors send.
void Run::learn_until_done() {
  LearnerLinkOptions how;
  how.traversal = options_.train;
  how.traversal_hash = seat_on(options_.train)->info.hash();
  how.window = options_.window;
  how.most_lag = options_.most_lag;
  how.job = job_;
  link_ = std::make_unique<LearnerLink>(node_, *trainer_, how);
  fleet_.hear(/*observations=*/false, /*episodes=*/true);
  Clock::time_point next_word = Clock::now() + std::chrono::seconds(5);
  while (!trainer_->done()) {
    spin();
    if (!link_->ready()) {
      if (link_->actors() == 0) {
        node_.report(msg::WAITING, "waiting for actors");
        if (Clock::now() > next_word) spdlog::info("waiting for actors (policy_service --role actor)");
      }
      if (link_->actors() > 0 || Clock::now() > next_word) next_word = Clock::now() + std::chrono::seconds(10);
      continue;
    }
    const std::uint64_t steps_before = trainer_->progress().steps;
    UpdateFigures figures;
    {
      const Stopwatch watch(report_.update);
      trainer_->come_to(time_over());
      figures = link_->learn();
    }
    after_update(figures, steps_before);
    if (trainer_->done() || time_over() >= 1) break;
    const std::uint64_t updates = trainer_->progress().updates;
    if (updates % static_cast<std::uint64_t>(options_.checkpoint_every) == 0) save_checkpoint();
    if (options_.evaluate_every > 0 && updates % static_cast<std::uint64_t>(options_.evaluate_every) == 0) {
      fleet_.hear(true, true);
      evaluate_others();
      fleet_.hear(false, true);
    }
  }
  report_.wall = training_wall();
  link_->end();
  const Clock::time_point deadline = Clock::now() + std::chrono::seconds(5);
  while (!link_->released() && Clock::now() < deadline) spin();
  fleet_.hear(true, true);
  // Actors that started later than this process were obeyed; now it is to be.
  for (const auto& [id, seat] : fleet_.seats()) fleet_.take_charge(*seat);
  spdlog::info("mean lag {:.2f} updates, {} trajectories were too old, actors waited {:.1f} s for room", report_.lag,
               link_->dropped(), link_->waited());
  report_.dropped = link_->dropped();
  report_.waited = link_->waited();
}

void Run::train() {
  await({options_.train}, options_.environments);
  build_trainer();
  spdlog::info("training {} on '{}': {} steps, seed {}, {}", options_.agent, options_.train, trainer_->total_steps(),
               options_.seed, node_.middleware_name());
  training_since_ = last_update_ = Clock::now();
  if (options_.role == "learner") {
    learn_until_done();
  } else {
    fleet_.joined = [this](Seat& seat) {
      if (seat.traversal() == options_.train) enroll(seat);
    };
    fleet_.decide = [this](Seat& seat, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
      const Stopwatch watch(report_.inference);
      return taking_part_.contains(&seat) && trainer_->act(slots_.at(&seat), observation, choice);
    };
    for (Seat* seat : seats_on(options_.train)) enroll(*seat);
    train_until_done();
  }
  progress_.finish();
  fleet_.joined = nullptr;
  fleet_.decide = nullptr;
  const TrainingProgress& progress = trainer_->progress();
  report_.traversal = options_.train;
  report_.episodes = progress.episodes;
  report_.steps = progress.steps;
  if (!link_) report_.wall = training_wall();
  report_.reward = progress.reward;
  report_.spl = progress.spl;
  save_checkpoint();
  agent_ = trainer_->agent();
  const double here = std::max(seconds_since(training_since_), 1e-9);
  spdlog::info(
      "trained {} episodes, {} steps in {:.1f} s ({:.0f} steps/s): {:.0f} % inference, {:.0f} % update, {:.0f} % "
      "waiting for environments and transport",
      report_.episodes, report_.steps, report_.wall, static_cast<double>(report_.steps) / std::max(report_.wall, 1e-9),
      100 * report_.inference / here, 100 * report_.update / here,
      100 * std::max(0.0, 1 - (report_.inference + report_.update) / here));
}

// -------------------------------------------------------------------------------------------------- evaluation

void Run::load_agent() {
  agent_ = trained_agent(read_checkpoint(options_.checkpoint));
  if (!agent_->task.turns.empty())
    throw Error("learned a route that crosses itself, and env_services cannot tell theirs yet", options_.checkpoint,
                "try it in one process (tools/inprocess)");
  if (!options_.parameters.empty()) load_parameters(options_.parameters, *agent_);
  if (options_.max_steps == options_.frames) options_.max_steps = agent_->task.frames;
  options_.agent = agent_->name;
  options_.first_frame = agent_->first_frame;
  options_.frames = agent_->task.frames;
}

Evaluation::MakePolicy Run::agent_policy() const {
  NetworkPolicy::Options how;
  how.seed = mix_seeds({options_.seed, kEvaluationChoices});
  return [agent = *agent_, how](const Seat&) { return std::make_unique<NetworkPolicy>(agent, how); };
}

std::vector<Seat*> Run::evaluation_seats() {
  std::set<std::string> traversals(options_.evaluate.begin(), options_.evaluate.end());
  if (traversals.empty())
    for (const auto& [id, seat] : fleet_.seats())
      if (Fleet::alive(*seat)) traversals.insert(seat->traversal());
  await(traversals, 1);
  std::vector<Seat*> seats;
  for (const std::string& traversal : traversals) seats.push_back(seat_on(traversal));
  return seats;
}

/// Features of the training traversal's route, once; empty when it has none or is not there.
const std::vector<float>& Run::reference() {
  if (!reference_.empty()) return reference_;
  Seat* seat = seat_on(options_.train);
  if (!seat || seat->info.feature_dimension() == 0) return reference_;
  return reference_ = fleet_.fetch_features(*seat, options_.first_frame, options_.frames,
                                            Clock::now() + std::chrono::seconds(30));
}

void Run::evaluate(const std::string& name, bool shuffle, const Evaluation::MakePolicy& make,
                   const std::vector<Seat*>& seats) {
  EvaluationOptions what;
  what.first_frame = options_.first_frame;
  what.frames = options_.frames;
  what.max_steps = options_.max_steps;
  what.tasks = options_.tasks;
  what.seed = mix_seeds({options_.seed, kEvaluationTasks});
  what.shuffle = shuffle;
  what.policy = name;
  if (agent_ && name == options_.agent) what.update = agent_->update;
  what.job = job_;
  const std::string label = shuffle ? "shuffled" : name;
  Evaluation evaluation(fleet_, seats, what, make);
  const auto record = fleet_.finished;
  fleet_.finished = [&](Seat& seat, const msg::EpisodeStat& episode) {
    record(seat, episode);
    evaluation.add(seat, episode);
  };
  const auto decide = fleet_.decide;
  fleet_.decide = [&](Seat& seat, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
    if (evaluation.takes_part(seat)) return evaluation.decide(seat, observation, choice);
    return decide && decide(seat, observation, choice);
  };
  const auto joined = fleet_.joined;
  fleet_.joined = [&](Seat& seat) {
    if (evaluation.takes_part(seat)) evaluation.begin(seat);
    if (joined) joined(seat);
  };
  const auto restore = [&] {
    fleet_.finished = record;
    fleet_.joined = joined;
    fleet_.decide = decide;
  };
  try {
    const Clock::time_point since = Clock::now();
    for (Seat* seat : seats) evaluation.begin(*seat);
    node_.report(msg::RUNNING, "evaluating " + label);
    while (!evaluation.done()) {
      spin();
      evaluation.check_alive();
      const double rate = static_cast<double>(evaluation.steps()) / std::max(1e-9, seconds_since(since));
      progress_.show("evaluating " + label, evaluation.share(), rate, -1, "");
    }
  } catch (...) {
    progress_.finish();
    restore();
    throw;
  }
  progress_.finish();
  restore();
  for (const auto& [traversal, result] : evaluation.scores()) rows_.push_back({label, traversal, result});
}

void Run::evaluate_all() {
  const std::vector<Seat*> seats = evaluation_seats();
  if (!record_) begin_record();
  const auto make_control = [this](const std::string& name) -> Evaluation::MakePolicy {
    const auto& entry = ControlRegistry::instance().find("control", name);
    const Parameters parameters(name, entry.parameters, options_.control_parameters[name]);
    ControlTask task{options_.first_frame, options_.frames, 0, {}};
    if (name == "sequence_filter") {
      task.reference = reference();
      task.dimension = static_cast<int>(task.reference.size()) / options_.frames;
    }
    return [&entry, parameters, task](const Seat&) { return entry.create(parameters, task); };
  };
  const Evaluation::MakePolicy agent = control_alone_ ? make_control(options_.agent) : agent_policy();
  evaluate(options_.agent, false, agent, seats);
  for (const std::string& name : options_.controls) {
    if (name == options_.agent) continue;
    if (name == "shuffled") {
      evaluate(options_.agent, true, agent, seats);
    } else if (name == "sequence_filter" && reference().empty()) {
      spdlog::warn("no sequence_filter: traversal '{}' has no features or no env_service", options_.train);
    } else {
      evaluate(name, false, make_control(name), seats);
    }
  }
}

/// At the end nobody tries again any more.
void Run::require_all_written() {
  if (unsaved_) unsaved_->again = {};
  write_unsaved();
  acknowledge();
  if (unsaved_)
    throw Error("no checkpoint of update " + std::to_string(unsaved_->update) + " could be written", options_.output,
                "free some space, then go on with --resume");
  if (!episodes_->problem().empty()) throw Error(episodes_->problem());
}

void Run::write_summary() {
  if (options_.output.empty()) return;
  write_file(options_.output + "/summary.json", summary_json(options_, trainer_ ? &report_ : nullptr, rows_));
}

/// The env_services wait for the next policy_service, and need keep nothing for this one.
void Run::leave() {
  if (record_) record_->end();
  msg::TaskSettings idle;
  idle.task_mode() = msg::IDLE;
  for (const auto& [id, seat] : fleet_.seats())
    if (Fleet::alive(*seat)) fleet_.command(*seat, idle);
  const Clock::time_point deadline = Clock::now() + std::chrono::milliseconds(500);
  const auto pending = [this] {
    return std::any_of(fleet_.seats().begin(), fleet_.seats().end(),
                       [](const auto& entry) { return Fleet::alive(*entry.second) && !entry.second->in_force; });
  };
  while (pending() && Clock::now() < deadline && !stop_requested()) {
    fleet_.spin(deadline);
    acknowledge();
  }
  fleet_.end_recording();
}

int Run::execute() {
  try {
    if (options_.mode == "train") {
      train();
    } else if (!control_alone_) {
      load_agent();
    }
    evaluate_all();
  } catch (const Stopped&) {
    progress_.finish();
    spdlog::info("stopped by a signal{}", options_.mode == "train" && !options_.output.empty()
                                              ? "; --resume goes on after the last checkpoint"
                                              : "");
    return 130;
  }
  require_all_written();
  write_summary();
  std::cout << table(rows_) << std::flush;
  if (!options_.output.empty()) spdlog::info("wrote {}/summary.json", options_.output);
  leave();
  return 0;
}

}  // namespace

PolicyServiceOptions checked_options(PolicyServiceOptions options) {
  if (options.max_steps == 0) options.max_steps = options.frames;
  if (std::find(options.controls.begin(), options.controls.end(), "all") != options.controls.end()) {
    options.controls = {"shuffled"};
    for (const auto* entry : ControlRegistry::instance().entries()) options.controls.push_back(entry->name);
  }
  if (!options.parameters.empty() && options.checkpoint.empty())
    throw Error("needs --checkpoint", "--parameters", "name the checkpoint of the agent that they are for");
  for (const std::string& name : options.controls)
    if (name != "shuffled") ControlRegistry::instance().find("control", name);
  if (options.mode != "train" && (!options.initial.empty() || !options.frozen.empty()))
    throw Error("is for --mode train", options.initial.empty() ? "--freeze" : "--initial");
  if (options.role != "both" && options.mode != "train") throw Error("is for --role both", "--mode " + options.mode);
  if (options.role == "learner" && options.lockstep)
    throw Error("is for --role both", "--lockstep", "what a learner gets when depends on its actors");
  if (options.mode == "train") {
    NetworkRegistry<float>::instance().find("agent", options.agent);
    LearnerRegistry::instance().find("learner", options.learner);
    if (!options.checkpoint.empty())
      throw Error("not for --mode train", "--checkpoint",
                  "to go on training use --resume, to train its agent on another route --initial");
    if (options.resume && options.output.empty()) throw Error("needs --output", "--resume");
  } else if (options.checkpoint.empty()) {
    ControlRegistry::instance().find("control", options.agent);
  }
  if (options.curriculum && options.frames != 128)
    throw Error("the paper's lessons end with 128 frames", "--curriculum", "leave --frames out");
  return options;
}

int run_policy_service(const PolicyServiceOptions& options) {
  const PolicyServiceOptions complete = checked_options(options);
  if (complete.role == "actor") return run_actor({complete.node, complete.stay});
  Node node(complete.node);
  const Farewell farewell(node);
  Fleet fleet(node, complete.fleet);
  return Run(complete, node, fleet).execute();
}

int run_policy_service(const PolicyServiceOptions& options, Node& node, Fleet& fleet) {
  return Run(options, node, fleet).execute();
}

}  // namespace citylearn
