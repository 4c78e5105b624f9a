#include "policy_service/policy_service.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <set>

#include "core/service.h"
#include "policy_service/checkpoint.h"
#include "policy_service/control.h"
#include "policy_service/episode_log.h"
#include "policy_service/evaluation.h"
#include "policy_service/files.h"
#include "policy_service/fleet.h"
#include "policy_service/metrics_log.h"
#include "policy_service/progress.h"
#include "policy_service/report.h"
#include "policy_service/score.h"
#include "policy_service/trainer.h"

namespace citylearn {
namespace {

// Purposes of random streams: (seed, purpose, ...) names a stream.
enum : std::uint64_t { kTrainingTasks = 101, kEvaluationTasks = 102, kEvaluationChoices = 103 };

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Thrown to leave whatever is going on when a signal asks the service to stop.
struct Stopped {};

class Run {
 public:
  explicit Run(const PolicyServiceOptions& options);
  int execute();

 private:
  void spin();
  void await(const std::set<std::string>& traversals, int training_environments);
  std::vector<Seat*> seats_on(const std::string& traversal) const;
  Seat* seat_on(const std::string& traversal) const;
  std::vector<Seat*> evaluation_seats();

  void build_trainer();
  void train();
  void enroll(Seat& seat);
  void cut();
  void drop_lost_seats();
  void after_update(const UpdateFigures& figures);
  void save_checkpoint();

  void load_agent();
  void evaluate_all();
  void evaluate(const std::string& name, bool shuffle, const Evaluation::MakePolicy& make, const std::vector<Seat*>& seats);
  std::vector<float> reference();
  void write_summary();

  PolicyServiceOptions options_;
  bool control_alone_ = false;      ///< mode evaluate without a checkpoint: the agent is a control
  Node node_;
  Fleet fleet_;
  std::unique_ptr<EpisodeLog> episodes_;
  std::unique_ptr<MetricsLog> metrics_;
  Progress progress_;
  std::set<Seat*> to_acknowledge_;
  std::unique_ptr<Trainer> trainer_;
  std::unique_ptr<TrainedAgent> agent_;
  std::map<const Seat*, int> slots_;        ///< training seats, and the index of each
  std::map<const Seat*, int> restarts_;
  Clock::time_point training_since_, last_update_;
  double wall_before_ = 0;
  TrainingReport report_;
  std::vector<ScoreRow> rows_;
  std::vector<float> reference_;
  std::map<std::string, std::string> hashes_;
};

PolicyServiceOptions checked(PolicyServiceOptions options) {
  if (options.max_steps == 0) options.max_steps = options.frames;
  if (std::find(options.controls.begin(), options.controls.end(), "all") != options.controls.end()) {
    options.controls = {"shuffled"};
    for (const auto* entry : ControlRegistry::instance().entries()) options.controls.push_back(entry->name);
  }
  for (const std::string& name : options.controls)
    if (name != "shuffled") ControlRegistry::instance().find("control", name);
  if (options.mode == "train") {
    NetworkRegistry<float>::instance().find("agent", options.agent);
    LearnerRegistry::instance().find("learner", options.learner);
    if (!options.checkpoint.empty()) throw Error("only for --mode evaluate", "--checkpoint", "to go on training use --resume");
    if (options.resume && options.output.empty()) throw Error("needs --output", "--resume");
  } else if (options.checkpoint.empty()) {
    ControlRegistry::instance().find("control", options.agent);
  }
  if (options.curriculum && options.frames != 128) throw Error("the paper's lessons end with 128 frames", "--curriculum", "leave --frames out");
  return options;
}

Run::Run(const PolicyServiceOptions& options) : options_(checked(options)), node_(options_.node), fleet_(node_) {
  control_alone_ = options_.mode == "evaluate" && options_.checkpoint.empty();
  if (!options_.output.empty()) {
    std::error_code error;
    std::filesystem::create_directories(options_.output + "/checkpoints", error);
    if (error) throw Error(error.message(), options_.output, "choose another --output");
  }
  const std::string log = options_.output.empty() ? "" : options_.output + "/episodes.csv";
  if (!options_.resume && !log.empty()) std::filesystem::remove(log);
  episodes_ = std::make_unique<EpisodeLog>(log);
  fleet_.finished = [this](Seat& seat, const msg::EpisodeStat& episode) {
    episodes_->record(episode);
    to_acknowledge_.insert(&seat);
  };
}

/// Everything waits here: messages, acknowledgements, signals.
void Run::spin() {
  fleet_.spin(Clock::now() + std::chrono::milliseconds(50));
  for (Seat* seat : to_acknowledge_) fleet_.acknowledge(*seat, episodes_->recorded(seat->id, seat->incarnation()));
  to_acknowledge_.clear();
  if (stop_requested()) throw Stopped();
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

void Run::await(const std::set<std::string>& traversals, int training_environments) {
  const Clock::time_point since = Clock::now();
  Clock::time_point next_word = since + std::chrono::seconds(5);
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
    const std::string found = here.empty() ? "none was found" : "found: " + here;
    if (options_.wait > 0 && seconds_since(since) > options_.wait)
      throw Error(fmt::format("no env_service on {} within {:.0f} s ({})", missing, options_.wait, found), "",
                  fmt::format("same --run '{}', --domain {} and --interface there?", options_.node.run, options_.node.middleware.domain));
    if (Clock::now() > next_word) {
      spdlog::info("waiting for env_services on {} ({})", missing, found);
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
  trainer.seed = options_.seed;
  trainer.steps = options_.steps;
  trainer.first_frame = options_.first_frame;
  trainer.max_steps = options_.max_steps;
  trainer.curriculum = options_.curriculum;
  trainer.task.frames = options_.frames;
  trainer.task.features = static_cast<int>(first.info.feature_dimension());
  reference_ = reference();
  if (!reference_.empty())
    trainer.task.reference = Eigen::Map<const Matrix<float>>(reference_.data(), trainer.task.features, options_.frames);
  trainer_ = std::make_unique<Trainer>(trainer);
  const std::string folder = options_.output.empty() ? "" : options_.output + "/checkpoints";
  std::string newest = options_.resume ? newest_checkpoint(folder) : "";
  if (!newest.empty()) {
    trainer_->load(newest);
    spdlog::info("going on after update {} ({} steps) of {}", trainer_->updates(), trainer_->steps(), newest);
  } else if (options_.resume) {
    spdlog::info("no checkpoint in {}: beginning", folder);
  }
  if (!options_.output.empty()) {
    metrics_ = std::make_unique<MetricsLog>(options_.output + "/metrics.csv", trainer_->updates());
    wall_before_ = metrics_->wall();
    write_file(options_.output + "/manifest.json",
               manifest_json(options_, trainer_->effective_parameters(), hashes_, node_.middleware_name()));
  }
}

void Run::enroll(Seat& seat) {
  if (!slots_.contains(&seat)) slots_[&seat] = static_cast<int>(slots_.size());
  const int slot = slots_[&seat];
  trainer_->enroll(slot, static_cast<int>(seat.info.agents()));
  const Lesson lesson = trainer_->lesson();
  msg::TaskSettings settings;
  settings.task_mode() = msg::TRAIN;
  settings.lesson() = static_cast<std::uint32_t>(lesson.index);
  settings.first_frame() = static_cast<std::uint32_t>(options_.first_frame);
  settings.frames() = static_cast<std::uint32_t>(lesson.frames);
  settings.max_steps() = static_cast<std::uint32_t>(lesson.max_steps);
  settings.seed() = mix_seeds({options_.seed, kTrainingTasks, trainer_->cuts(), static_cast<std::uint64_t>(slot),
                               static_cast<std::uint64_t>(restarts_[&seat])});
  fleet_.command(seat, settings);
}

/// After a checkpoint or a change of lesson every environment begins anew: docs/decisions/0003-step-protocol.md.
void Run::cut() {
  for (const auto& [seat, slot] : slots_)
    if (trainer_->enrolled(slot)) enroll(const_cast<Seat&>(*seat));
}

void Run::drop_lost_seats() {
  if (options_.lockstep) return;
  int alive = 0;
  for (const auto& [seat, slot] : slots_) alive += trainer_->enrolled(slot) && Fleet::alive(*seat);
  if (alive == 0) return;   // nobody to go on without them
  for (const auto& [seat, slot] : slots_) {
    if (!trainer_->enrolled(slot) || Fleet::alive(*seat)) continue;
    spdlog::warn("env_service '{}' went silent: training goes on without it", seat->id);
    trainer_->drop(slot);
  }
}

void Run::save_checkpoint() {
  if (options_.output.empty()) return;
  try {
    trainer_->save(options_.output + "/checkpoints");
  } catch (const Error& error) {
    // A full disk must not end the training: the last checkpoints are still there, and the next one may fit.
    spdlog::error("no checkpoint of update {}: {}", trainer_->updates(), error.what());
  }
}

void Run::after_update(const UpdateFigures& figures) {
  const double wall = wall_before_ + seconds_since(training_since_);
  const double rate = static_cast<double>(figures.steps) / std::max(1e-9, seconds_since(last_update_));
  last_update_ = Clock::now();
  const Lesson lesson = trainer_->lesson();
  msg::TrainingStat stat;
  stat.update() = trainer_->updates();
  stat.steps() = trainer_->steps();
  stat.episodes() = trainer_->episodes();
  stat.lesson() = static_cast<std::uint32_t>(lesson.index);
  stat.wall() = wall;
  stat.steps_per_second() = static_cast<float>(rate);
  stat.reward() = static_cast<float>(trainer_->mean_reward());
  stat.spl() = static_cast<float>(trainer_->mean_spl());
  stat.policy_loss() = static_cast<float>(figures.policy_loss);
  stat.value_loss() = static_cast<float>(figures.value_loss);
  stat.entropy() = static_cast<float>(figures.entropy);
  stat.divergence() = static_cast<float>(figures.divergence);
  stat.clipped() = static_cast<float>(figures.clipped);
  stat.gradient_norm() = static_cast<float>(figures.gradient_norm);
  stat.learning_rate() = static_cast<float>(figures.learning_rate);
  node_.publish(stat);
  if (metrics_) metrics_->write(stat);
  if (!report_.episodes_to_spl95 && trainer_->episodes_to_spl95() > 0) {
    report_.episodes_to_spl95 = trainer_->episodes_to_spl95();
    report_.wall_to_spl95 = wall;
  }
  const double share = std::max(static_cast<double>(trainer_->steps()) / static_cast<double>(trainer_->total_steps()),
                                options_.time_limit > 0 ? wall / options_.time_limit : 0.0);
  node_.report(msg::RUNNING, fmt::format("training {}, update {}", options_.agent, trainer_->updates()), static_cast<float>(rate));
  const double left = share > 0.01 ? (wall - wall_before_) * (1 - share) / share : -1;
  progress_.show("training " + options_.agent, share, static_cast<double>(trainer_->steps()) / std::max(wall, 1e-9), left,
                 fmt::format("reward {:.3f}  SPL {:.3f}{}", trainer_->mean_reward(), trainer_->mean_spl(),
                             options_.curriculum ? fmt::format("  lesson {}", lesson.index + 1) : ""));
}

void Run::train() {
  await({options_.train}, options_.environments);
  build_trainer();
  spdlog::info("training {} on '{}': {} steps, seed {}, {}", options_.agent, options_.train, trainer_->total_steps(), options_.seed,
               node_.middleware_name());
  fleet_.joined = [this](Seat& seat) {
    if (seat.traversal() != options_.train) return;
    ++restarts_[&seat];
    enroll(seat);
  };
  fleet_.decide = [this](Seat& seat, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
    const auto slot = slots_.find(&seat);
    return slot != slots_.end() && trainer_->observe(slot->second, observation, choice);
  };
  training_since_ = last_update_ = Clock::now();
  for (Seat* seat : seats_on(options_.train)) enroll(*seat);
  bool stopped = false;
  std::vector<std::uint8_t> choice;
  while (!trainer_->finished()) {
    try {
      spin();
    } catch (const Stopped&) {
      stopped = true;
      break;
    }
    drop_lost_seats();
    if (!trainer_->ready()) continue;
    const UpdateFigures figures = trainer_->update();
    after_update(figures);
    if (trainer_->finished() || (options_.time_limit > 0 && wall_before_ + seconds_since(training_since_) >= options_.time_limit)) break;
    const bool due = trainer_->updates() % static_cast<std::uint64_t>(options_.checkpoint_every) == 0;
    if (due) save_checkpoint();
    if (due || figures.new_lesson) {
      trainer_->cut();
      cut();
      continue;
    }
    if (options_.evaluate_every > 0 && trainer_->updates() % static_cast<std::uint64_t>(options_.evaluate_every) == 0) {
      // Those on other traversals only: the training environments wait, and their order of events stays what it is.
      agent_ = trainer_->agent();
      std::vector<Seat*> others;
      for (Seat* seat : evaluation_seats())
        if (seat->traversal() != options_.train) others.push_back(seat);
      const auto decide = fleet_.decide;
      if (!others.empty())
        evaluate(options_.agent, false, [this](const Seat& seat) { return agent_->policy(mix_seeds({options_.seed, kEvaluationChoices}), seat.info.agents()); }, others);
      for (const ScoreRow& row : rows_)
        spdlog::info("update {} on {}: completed {:.1f} %, SPL {:.3f}", trainer_->updates(), row.traversal, 100 * row.score.completed, row.score.spl);
      rows_.clear();
      fleet_.decide = decide;
    }
    for (const auto& [seat, slot] : slots_)
      if (seat->waiting && trainer_->act(slot, choice)) fleet_.answer(const_cast<Seat&>(*seat), choice);
  }
  progress_.finish();
  report_.traversal = options_.train;
  report_.episodes = trainer_->episodes();
  report_.steps = trainer_->steps();
  report_.wall = wall_before_ + seconds_since(training_since_);
  report_.reward = trainer_->mean_reward();
  report_.spl = trainer_->mean_spl();
  fleet_.joined = nullptr;
  fleet_.decide = nullptr;
  // A stop in the middle of a segment keeps the last regular checkpoint: only cuts can be gone on from byte for byte.
  if (stopped) throw Stopped();
  save_checkpoint();
  agent_ = trainer_->agent();
  spdlog::info("trained {} episodes, {} steps in {:.1f} s ({:.0f} steps/s)", report_.episodes, report_.steps, report_.wall,
               static_cast<double>(report_.steps) / report_.wall);
}

// -------------------------------------------------------------------------------------------------- evaluation

void Run::load_agent() {
  agent_ = load_agent_file(options_.checkpoint);
  options_.agent = agent_->name();
  options_.first_frame = agent_->first_frame();
  options_.frames = agent_->frames();
  if (options_.max_steps == 0 || options_.max_steps == 128) options_.max_steps = agent_->frames();
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
std::vector<float> Run::reference() {
  if (!reference_.empty()) return reference_;
  Seat* seat = seat_on(options_.train);
  if (!seat || seat->info.feature_dimension() == 0) return {};
  return reference_ = fleet_.fetch_features(*seat, options_.first_frame, options_.frames, Clock::now() + std::chrono::seconds(30));
}

void Run::evaluate(const std::string& name, bool shuffle, const Evaluation::MakePolicy& make, const std::vector<Seat*>& seats) {
  EvaluationOptions what;
  what.first_frame = options_.first_frame;
  what.frames = options_.frames;
  what.max_steps = options_.max_steps;
  what.tasks = options_.tasks;
  what.seed = mix_seeds({options_.seed, kEvaluationTasks});
  what.shuffle = shuffle;
  const std::string label = shuffle ? "shuffled" : name;
  Evaluation evaluation(fleet_, seats, what, make);
  const auto record = fleet_.finished;
  fleet_.finished = [&](Seat& seat, const msg::EpisodeStat& episode) {
    record(seat, episode);
    evaluation.add(seat, episode);
  };
  fleet_.decide = [&](Seat& seat, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
    return evaluation.takes_part(seat) && evaluation.decide(seat, observation, choice);
  };
  const auto joined = fleet_.joined;
  fleet_.joined = [&](Seat& seat) {
    if (evaluation.takes_part(seat)) evaluation.begin(seat);
    if (joined) joined(seat);
  };
  const auto restore = [&] {
    fleet_.finished = record;
    fleet_.joined = joined;
    fleet_.decide = nullptr;
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
  const auto make_control = [this](const std::string& name) {
    const auto& entry = ControlRegistry::instance().find("control", name);
    const Parameters parameters(name, entry.parameters, options_.control_parameters[name]);
    ControlTask task{options_.first_frame, options_.frames, 0, {}};
    if (name == "sequence_filter") {
      task.reference = reference();
      task.dimension = static_cast<int>(task.reference.size()) / options_.frames;
    }
    return [&entry, parameters, task](const Seat&) { return entry.create(parameters, task); };
  };
  const Evaluation::MakePolicy make_agent = [this](const Seat& seat) {
    return agent_->policy(mix_seeds({options_.seed, kEvaluationChoices}), static_cast<int>(seat.info.agents()));
  };
  evaluate(options_.agent, false, control_alone_ ? Evaluation::MakePolicy(make_control(options_.agent)) : make_agent, seats);
  for (const std::string& name : options_.controls) {
    if (name == options_.agent) continue;
    if (name == "shuffled") {
      evaluate(name, true, control_alone_ ? Evaluation::MakePolicy(make_control(options_.agent)) : make_agent, seats);
    } else if (name == "sequence_filter" && reference().empty()) {
      spdlog::warn("no sequence_filter: traversal '{}' has no features or no env_service", options_.train);
    } else {
      evaluate(name, false, make_control(name), seats);
    }
  }
}

void Run::write_summary() {
  if (options_.output.empty()) return;
  write_file(options_.output + "/summary.json", summary_json(options_, trainer_ ? &report_ : nullptr, rows_));
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
    spdlog::info("stopped by a signal{}", options_.mode == "train" && !options_.output.empty() ? "; --resume goes on after the last checkpoint" : "");
    return 130;
  }
  write_summary();
  std::cout << table(rows_) << std::flush;
  if (!options_.output.empty()) spdlog::info("wrote {}/summary.json", options_.output);
  // The env_services wait for the next policy_service.
  msg::TaskSettings idle;
  idle.task_mode() = msg::IDLE;
  for (const auto& [id, seat] : fleet_.seats())
    if (Fleet::alive(*seat)) fleet_.command(*seat, idle);
  const Clock::time_point deadline = Clock::now() + std::chrono::milliseconds(500);
  const auto pending = [this] {
    return std::any_of(fleet_.seats().begin(), fleet_.seats().end(), [](const auto& entry) {
      return Fleet::alive(*entry.second) && !entry.second->in_force;
    });
  };
  while (pending() && Clock::now() < deadline && !stop_requested()) fleet_.spin(deadline);
  return 0;
}

}  // namespace

int run_policy_service(const PolicyServiceOptions& options) { return Run(options).execute(); }

}  // namespace citylearn
