// SPDX-License-Identifier: Apache-2.0
#include "policy_service/learning/trainer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "policy_service/learning/trainer_state.h"

namespace citylearn {
namespace {

constexpr double kNavigatingSpl = 0.95;
constexpr std::uint64_t kRank = 110;  // purpose of random streams: (seed, kRank, rank) is the seed of one of several

/// Returns the authors' lessons, which end at N = 128, on a route of any N: 4, 8, 16 .. N, then the tighter step limit.
std::vector<Lesson> curriculum_of(int frames, int max_steps) {
  std::vector<Lesson> lessons;
  for (int n = 4; n < frames; n *= 2) lessons.push_back({n, n <= 64 ? 4 * n : 2 * n});
  lessons.push_back({frames, 2 * frames});
  lessons.push_back({frames, max_steps});
  return lessons;
}
constexpr double kLessonReward = 0.95;  // smoothed, to pass a lesson
constexpr std::uint64_t kLessonEpisodes = 100;

}  // namespace

double mean_steps(const std::deque<int>& steps) {
  if (steps.empty()) return std::numeric_limits<double>::quiet_NaN();
  return std::accumulate(steps.begin(), steps.end(), 0.0) / static_cast<double>(steps.size());
}

Trainer::Trainer(const TrainerOptions& options, const NetworkTask& task) : impl_(std::make_unique<Impl>()) {
  Impl& p = *impl_;
  p.options = options;
  p.task = task;
  if (task.frames < 2) throw Error("must be at least 2", "frames");
  if (task.streets && (options.curriculum || task.frames != task.streets->states()))
    throw Error("streets are learned as a whole, all " + std::to_string(task.streets->states()) + " frames",
                options.curriculum ? "--curriculum" : "frames", "leave out lessons and ranges of frames");
  if (p.options.max_steps == 0) p.options.max_steps = task.frames;
  p.parameters = TrainerParameters(options, task.streets != nullptr);
  p.segment = p.parameters.trainer.integer("segment");
  p.sequence = p.parameters.trainer.integer("sequence");
  if (p.segment % p.sequence != 0)
    throw Error("is " + std::to_string(p.segment) + ", must be a multiple of sequence, " + std::to_string(p.sequence),
                "trainer.segment");
  p.total_steps = static_cast<std::uint64_t>(p.parameters.trainer["steps"]);
  p.workers = std::make_unique<WorkerPool>(options.threads);
  p.lessons = {{task.frames, p.options.max_steps}};
  if (options.curriculum) p.lessons = curriculum_of(task.frames, p.options.max_steps);
  p.network = p.parameters.network_entry->create(p.parameters.network, p.task);
  p.shared_network = p.parameters.network_entry->create(p.parameters.network, p.task);
  p.learner = p.parameters.learner_entry->create(
      p.parameters.learner,
      LearnerTask{*p.network, options.agent, p.parameters.network, p.task, *p.workers, options.seed, p.total_steps});
  if (options.initial) p.start_from(*options.initial);
  p.options.initial.reset();
  if (!options.frozen.empty()) p.freeze();
  p.collector_seed =
      options.rank == 0 ? options.seed : mix_seeds({options.seed, kRank, static_cast<std::uint64_t>(options.rank)});
  p.collector = std::make_unique<Collector>(
      CollectorOptions{p.collector_seed, options.first_frame, p.segment, p.sequence,
                       p.parameters.trainer["noise-frame"], p.parameters.trainer["noise-place"],
                       p.parameters.trainer["noise-episode"]},
      p.task, *p.network, *p.workers);
  p.collector->reset_all(p.generation, p.lesson().frames);
  p.progress.reward = p.progress.spl = p.progress.episode_length = std::numeric_limits<double>::quiet_NaN();
}

Trainer::~Trainer() = default;

namespace {

std::string shape(const Tensor& tensor) { return std::to_string(tensor.rows) + " x " + std::to_string(tensor.cols); }

}  // namespace

/// Gives the learner the agent's parameters, as if it had just reached them.
void Trainer::Impl::start_from(const TrainedAgent& agent) {
  const std::string where = "initial agent";
  if (agent.name != options.agent)
    throw Error("is a '" + agent.name + "', the one to train a '" + options.agent + "'", where);
  const std::vector<Tensor>&theirs = agent.network->tensors(), &ours = network->tensors();
  for (std::size_t i = 0; i < std::max(theirs.size(), ours.size()); ++i) {
    if (i >= ours.size() || i >= theirs.size() || theirs[i].name != ours[i].name)
      throw Error("has the tensors " + joined(theirs, &Tensor::name) + "; needed are " + joined(ours, &Tensor::name),
                  where, "train with the network parameters that it had");
    if (theirs[i].rows != ours[i].rows || theirs[i].cols != ours[i].cols)
      throw Error("tensor '" + ours[i].name + "' is " + shape(theirs[i]) + ", here it must be " + shape(ours[i]), where,
                  "train with the same features and network parameters as it was");
  }
  if (!agent.parameters.allFinite()) throw Error("has parameters that are not finite", where);
  LearnerState state;
  learner->save(state);
  state.tensors["parameters"] = agent.parameters;
  learner->load(state);
  if (learner->parameters() != agent.parameters)
    throw Error("learner '" + options.learner + "' cannot start from given parameters", where,
                "choose another learner");
}

void Trainer::Impl::freeze() {
  const std::vector<Tensor>& all = network->tensors();
  std::vector<Tensor> chosen;
  for (const Tensor& tensor : all)
    if (std::any_of(options.frozen.begin(), options.frozen.end(),
                    [&](const std::string& beginning) { return tensor.name.starts_with(beginning); }))
      chosen.push_back(tensor);
  for (const std::string& beginning : options.frozen)
    if (beginning.empty() ||
        std::none_of(all.begin(), all.end(), [&](const Tensor& tensor) { return tensor.name.starts_with(beginning); }))
      throw Error("no tensor of network '" + options.agent + "' begins with '" + beginning + "'", "tensors to freeze",
                  "it has " + joined(all, &Tensor::name));
  if (chosen.size() == all.size())
    throw Error("nothing is left to learn", "tensors to freeze", "freeze fewer of " + joined(all, &Tensor::name));
  if (!learner->freeze(chosen))
    throw Error("learner '" + options.learner + "' cannot keep tensors as they are", "tensors to freeze",
                "choose another learner");
  for (const Tensor& tensor : chosen) frozen.push_back(tensor.name);
}

const std::vector<std::string>& Trainer::frozen() const { return impl_->frozen; }

// Environments.

void Trainer::add(int environment, int agents, int experience) {
  impl_->collector->add(environment, agents, experience);
}

void Trainer::remove(int environment) { impl_->collector->remove(environment); }

void Trainer::settings(int environment, msg::TaskSettings& settings) const {
  const Impl& p = *impl_;
  settings.task_mode() = msg::TRAIN;
  settings.lesson() = static_cast<std::uint32_t>(p.progress.lesson);
  settings.first_frame() = static_cast<std::uint32_t>(p.options.first_frame);
  settings.frames() = static_cast<std::uint32_t>(p.lesson().frames);
  settings.max_steps() = static_cast<std::uint32_t>(p.lesson().max_steps);
  settings.max_detour() = static_cast<std::uint32_t>(p.options.max_detour);
  settings.goal_radius() = p.task.goal_radius;
  settings.seed() = p.collector->environment_seed(environment);
  settings.tasks() = 0;
  settings.shuffle() = false;
  settings.policy() = p.options.agent.c_str();
  settings.update() = p.progress.updates;
}

bool Trainer::full(int environment) const { return impl_->collector->full(environment); }

bool Trainer::ready() const { return impl_->collector->ready(); }

// Acting.

bool Trainer::act(int environment, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  return impl_->collector->act(environment, observation, impl_->learner->parameters(), choice);
}

void Trainer::resume(int environment, std::vector<std::uint8_t>& choice) {
  impl_->collector->resume(environment, impl_->learner->parameters(), choice);
}

void Trainer::believe(int environment, msg::Belief& belief) const { impl_->collector->believe(environment, belief); }

// Learning.

void Trainer::set_progress(double fraction) {
  impl_->elapsed = fraction;
  impl_->learner->set_progress(fraction);
}

UpdateFigures Trainer::update() {
  Collector& collector = *impl_->collector;
  if (!ready()) throw Error("not every environment's segment is full", "trainer");
  std::vector<Rollout*> rollouts;
  std::vector<std::pair<std::array<int, 3>, FinishedEpisode>> ends;
  for (const int id : collector.environments()) {
    rollouts.push_back(&collector.rollout(id));
    for (const FinishedEpisode& episode : collector.finished(id))
      ends.push_back({{episode.tick, id, episode.agent}, episode});
  }
  std::sort(ends.begin(), ends.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<FinishedEpisode> finished;
  for (const auto& [order, episode] : ends) finished.push_back(episode);
  return learn(rollouts, finished);
}

void Trainer::prepare(Rollout& rollout) const {
  rollout.max_steps = impl_->lesson().max_steps;
  rollout.max_detour = impl_->options.max_detour;
  rollout.step_cost = static_cast<float>(impl_->parameters.trainer["step-cost"]);
  for (float& reward : rollout.reward) reward = rollout.learned(reward);
}

UpdateFigures Trainer::learn(std::span<Rollout* const> rollouts, std::span<const FinishedEpisode> finished) {
  Impl& p = *impl_;
  std::uint64_t steps = 0;
  for (Rollout* rollout : rollouts) {
    prepare(*rollout);
    steps += rollout->action.size();
  }
  UpdateFigures figures;
  const auto update = [&] { figures = p.learner->update(rollouts); };
  if (p.sharing) {
    LocalUpdate mine;
    mine.steps = steps;
    mine.episodes.assign(finished.begin(), finished.end());
    p.share(std::move(mine), update);
    return figures;
  }
  update();
  for (const int id : p.collector->environments()) p.collector->begin_segment(id);
  ++p.progress.updates;
  p.progress.steps += steps;
  p.count_episodes(finished);
  return figures;
}

void Trainer::Impl::count_episodes(std::span<const FinishedEpisode> finished) {
  double rewards = 0;
  for (const FinishedEpisode& episode : finished) {
    ++progress.episodes;
    rewards += episode.reward;
    if (recent.size() < kRecent) recent.emplace_back();
    recent[recent_next] = {episode.reward, episode.spl};
    recent_next = (recent_next + 1) % kRecent;
    recent_steps.push_back(episode.steps);
    if (recent_steps.size() > kRecent) recent_steps.pop_front();
    progress.reward = progress.spl = 0;
    for (const auto& [reward, spl] : recent) {
      progress.reward += reward;
      progress.spl += spl;
    }
    progress.reward /= static_cast<double>(recent.size());
    progress.spl /= static_cast<double>(recent.size());
    if (recent.size() == kRecent && progress.spl >= kNavigatingSpl && !progress.episodes_to_spl95) {
      progress.episodes_to_spl95 = progress.episodes;
      progress.steps_to_spl95 = progress.steps;
    }
  }
  if (finished.empty()) return;
  progress.episode_length = mean_steps(recent_steps);
  progress.smoothed_reward = 0.25 * rewards / static_cast<double>(finished.size()) + 0.75 * progress.smoothed_reward;
  lesson_episodes += finished.size();
  if (progress.lesson + 1 == static_cast<int>(lessons.size()) || progress.smoothed_reward <= kLessonReward ||
      lesson_episodes < kLessonEpisodes)
    return;
  ++progress.lesson;
  lesson_episodes = 0;
  begin_generation();
}

std::uint64_t Trainer::generation() const { return impl_->generation; }
const TrainingProgress& Trainer::progress() const { return impl_->progress; }
std::uint64_t Trainer::total_steps() const { return impl_->total_steps; }
bool Trainer::done() const { return impl_->progress.steps >= impl_->total_steps; }
bool Trainer::settled() const {
  return impl_->progress.lesson + 1 == static_cast<int>(impl_->lessons.size()) && impl_->lesson_episodes >= kRecent;
}

const Vector<float>& Trainer::network_parameters() const { return impl_->learner->parameters(); }

int Trainer::batch() const {
  const Impl& p = *impl_;
  return p.parameters.trainer.integer("agents") * (p.segment / p.sequence);
}

void Trainer::describe(msg::LearnerInfo& info) const {
  const Impl& p = *impl_;
  info.agent() = p.options.agent.c_str();
  std::string text;
  for (const auto& [name, value] : p.parameters.network.values())
    text += (text.empty() ? "" : " ") + name + "=" + nlohmann::json(value).dump();
  info.network() = text.c_str();
  info.seed() = p.collector_seed;
  info.feature_dimension() = static_cast<std::uint32_t>(p.task.features);
  info.first_frame() = static_cast<std::uint32_t>(p.options.first_frame);
  info.frames() = static_cast<std::uint32_t>(p.task.frames);
  info.lesson() = static_cast<std::uint32_t>(p.progress.lesson);
  info.lesson_frames() = static_cast<std::uint32_t>(p.lesson().frames);
  info.max_steps() = static_cast<std::uint32_t>(p.lesson().max_steps);
  info.max_detour() = static_cast<std::uint32_t>(p.options.max_detour);
  info.steps() = static_cast<std::uint32_t>(p.sequence);
  info.noise_frame() = p.parameters.trainer["noise-frame"];
  info.noise_place() = p.parameters.trainer["noise-place"];
  info.noise_episode() = p.parameters.trainer["noise-episode"];
}

TrainedAgent Trainer::agent() const {
  const Impl& p = *impl_;
  return {p.options.agent,
          p.task,
          p.options.first_frame,
          p.shared_network,
          p.learner->parameters(),
          p.progress.updates,
          {},
          p.task.streets ? p.task.places() : 0,
          p.parameters.network.values()};
}

std::map<std::string, std::map<std::string, double>> Trainer::parameters() const { return impl_->parameters.values(); }

}  // namespace citylearn
