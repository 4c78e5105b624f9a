// SPDX-License-Identifier: Apache-2.0
#include "policy_service/learning/trainer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/task/route_map.h"
#include "policy_service/rollout/collector.h"

namespace citylearn {
namespace {

constexpr int kRecent = 100;  // episodes in the running means
constexpr double kNavigates = 0.95;

struct Lesson {
  int frames, max_steps;
};

/// The authors' lessons on a route of N frames: N = 4 .. 128, then the tighter step limit.
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

struct Trainer::Parts {
  TrainerOptions options;
  NetworkTask task;
  Parameters network_parameters, learner_parameters, trainer_parameters;
  std::unique_ptr<const AgentNetwork<float>> network;
  std::shared_ptr<const AgentNetwork<float>> shared_network;  // of agent()
  std::unique_ptr<Learner> learner;
  int segment = 0, sequence = 0;
  std::uint64_t total_steps = 0;
  std::vector<std::string> frozen;  // names of tensors, in their order
  std::vector<Lesson> lessons;

  std::unique_ptr<Collector> collector;
  std::uint64_t cut = 0;
  TrainingProgress progress;
  std::uint64_t lesson_episodes = 0;          // finished in the present lesson
  std::vector<std::array<double, 2>> recent;  // reward and SPL of the last episodes, a ring
  std::size_t recent_next = 0;

  const Lesson& lesson() const { return lessons[static_cast<std::size_t>(progress.lesson)]; }
  void begin_cut() {
    ++cut;
    collector->begin_cut(cut, lesson().frames);
  }

  void count_episodes(std::span<const FinishedEpisode> finished);
  void take_over(const TrainedAgent& agent);
  void freeze();
  nlohmann::json identity() const;
};

// Construction.

std::vector<ParameterSpec> Trainer::parameter_specs() {
  return {{"segment", "steps of each agent between updates", 64, 1, 65536, true},
          {"sequence", "steps that gradients go back; divides the segment", 64, 1, 65536, true},
          {"steps", "environment steps of the whole run", 40000, 1, 1e12, true},
          {"agents", "agents to train with; fewer or more will do", 16, 1, msg::MAX_AGENTS, true},
          {"noise-frame", "length of the noise on features, new at each look, in lengths of these", 1, 0, 100},
          {"noise-place", "length of each place's noise, likewise; it stays for an episode", 0, 0, 100},
          {"noise-episode", "length of the shift of all features of an episode, likewise", 3, 0, 100}};
}

namespace {

struct Choices {
  const NetworkRegistry<float>::Entry* network;
  const LearnerRegistry::Entry* learner;
  Parameters network_parameters, learner_parameters, trainer_parameters;
};

/// A network's recommendations for use with this learner: "relabel.epochs" is for the learner relabel alone, and stands
/// over "epochs", which is for all.
std::map<std::string, double> recommended_for(const std::string& learner, const std::map<std::string, double>& all) {
  std::map<std::string, double> chosen;
  for (const auto& [name, value] : all)
    if (name.find('.') == name.npos) chosen[name] = value;
  for (const auto& [name, value] : all)
    if (name.starts_with(learner + ".")) chosen[name.substr(learner.size() + 1)] = value;
  return chosen;
}

/// Parameters given, over what the network recommends, over defaults.
Choices choose(const TrainerOptions& options) {
  Choices chosen;
  chosen.network = &NetworkRegistry<float>::instance().find("network", options.agent);
  chosen.learner = &LearnerRegistry::instance().find("learner", options.learner);
  const std::vector<ParameterSpec> specs = Trainer::parameter_specs();
  std::map<std::string, double> for_learner, for_trainer;
  for (const auto& [name, value] : recommended_for(options.learner, chosen.network->recommended)) {
    const auto is_name = [&name = name](const ParameterSpec& spec) { return spec.name == name; };
    if (std::any_of(specs.begin(), specs.end(), is_name))
      for_trainer[name] = value;
    else if (std::any_of(chosen.learner->parameters.begin(), chosen.learner->parameters.end(), is_name))
      for_learner[name] = value;  // another learner may not know it
  }
  for (const auto& [name, value] : options.learner_parameters) for_learner[name] = value;
  for (const auto& [name, value] : options.trainer_parameters) for_trainer[name] = value;
  chosen.network_parameters = {"network " + options.agent, chosen.network->parameters, options.network_parameters};
  chosen.learner_parameters = {"learner " + options.learner, chosen.learner->parameters, for_learner};
  chosen.trainer_parameters = {"trainer", specs, for_trainer};
  return chosen;
}

}  // namespace

Trainer::Trainer(const TrainerOptions& options, const NetworkTask& task) : parts_(std::make_unique<Parts>()) {
  Parts& p = *parts_;
  p.options = options;
  p.task = task;
  if (task.frames < 2) throw Error("must be at least 2", "frames");
  check_turns(task.turns, task.frames);
  if (!task.turns.empty() && options.curriculum)
    throw Error("has lessons on the beginning of the route, and this route crosses itself", "curriculum",
                "train without it");
  if (p.options.max_steps == 0) p.options.max_steps = task.frames;
  Choices chosen = choose(options);
  p.network_parameters = std::move(chosen.network_parameters);
  p.learner_parameters = std::move(chosen.learner_parameters);
  p.trainer_parameters = std::move(chosen.trainer_parameters);
  p.segment = p.trainer_parameters.integer("segment");
  p.sequence = p.trainer_parameters.integer("sequence");
  if (p.segment % p.sequence != 0)
    throw Error("is " + std::to_string(p.segment) + ", must be a multiple of sequence, " + std::to_string(p.sequence),
                "trainer.segment");
  p.total_steps = static_cast<std::uint64_t>(p.trainer_parameters["steps"]);
  p.lessons = {{task.frames, p.options.max_steps}};
  if (options.curriculum) p.lessons = curriculum_of(task.frames, p.options.max_steps);
  p.network = chosen.network->create(p.network_parameters, p.task);
  p.shared_network = chosen.network->create(p.network_parameters, p.task);
  p.learner = chosen.learner->create(p.learner_parameters, LearnerTask{*p.network, options.agent, p.network_parameters,
                                                                       p.task, options.seed, p.total_steps});
  if (options.initial) p.take_over(*options.initial);
  p.options.initial.reset();
  if (!options.frozen.empty()) p.freeze();
  p.collector = std::make_unique<Collector>(
      CollectorOptions{options.seed, options.first_frame, p.segment, p.sequence, p.trainer_parameters["noise-frame"],
                       p.trainer_parameters["noise-place"], p.trainer_parameters["noise-episode"]},
      p.task, *p.network);
  p.collector->begin_cut(p.cut, p.lesson().frames);
  p.progress.reward = p.progress.spl = std::numeric_limits<double>::quiet_NaN();
}

Trainer::~Trainer() = default;

namespace {

std::string shape(const Tensor& tensor) { return std::to_string(tensor.rows) + " x " + std::to_string(tensor.cols); }

std::string names(const std::vector<Tensor>& tensors) {
  std::string all;
  for (const Tensor& tensor : tensors) all += (all.empty() ? "" : ", ") + tensor.name;
  return all;
}

}  // namespace

/// The learner begins as if it had come to the agent's parameters, and knows nothing else of how.
void Trainer::Parts::take_over(const TrainedAgent& agent) {
  const std::string where = "initial agent";
  if (agent.name != options.agent)
    throw Error("is a '" + agent.name + "', the one to train a '" + options.agent + "'", where);
  const std::vector<Tensor>&theirs = agent.network->tensors(), &ours = network->tensors();
  for (std::size_t i = 0; i < std::max(theirs.size(), ours.size()); ++i) {
    if (i >= ours.size() || i >= theirs.size() || theirs[i].name != ours[i].name)
      throw Error("has the tensors " + names(theirs) + "; needed are " + names(ours), where);
    if (theirs[i].rows != ours[i].rows || theirs[i].cols != ours[i].cols)
      throw Error("tensor '" + ours[i].name + "' is " + shape(theirs[i]) + ", here it must be " + shape(ours[i]), where,
                  "train with the same features and network parameters as it was");
  }
  if (!agent.parameters.allFinite()) throw Error("has parameters that are no numbers", where);
  LearnerState state;
  learner->save(state);
  state.tensors["parameters"] = agent.parameters;
  learner->load(state);
  if (learner->parameters() != agent.parameters)
    throw Error("learner '" + options.learner + "' cannot begin with given parameters", where,
                "choose another learner");
}

void Trainer::Parts::freeze() {
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
                  "it has " + names(all));
  if (chosen.size() == all.size())
    throw Error("nothing is left to learn", "tensors to freeze", "freeze fewer of " + names(all));
  if (!learner->freeze(chosen))
    throw Error("learner '" + options.learner + "' cannot keep tensors as they are", "tensors to freeze",
                "choose another learner");
  for (const Tensor& tensor : chosen) frozen.push_back(tensor.name);
}

const std::vector<std::string>& Trainer::frozen() const { return parts_->frozen; }

// Environments.

void Trainer::add(int environment, int agents) { parts_->collector->add(environment, agents); }

void Trainer::remove(int environment) { parts_->collector->remove(environment); }

void Trainer::settings(int environment, msg::TaskSettings& settings) const {
  const Parts& p = *parts_;
  settings.task_mode() = msg::TRAIN;
  settings.lesson() = static_cast<std::uint32_t>(p.progress.lesson);
  settings.first_frame() = static_cast<std::uint32_t>(p.options.first_frame);
  settings.frames() = static_cast<std::uint32_t>(p.lesson().frames);
  settings.max_steps() = static_cast<std::uint32_t>(p.lesson().max_steps);
  settings.seed() = p.collector->environment_seed(environment);
  settings.tasks() = 0;
  settings.shuffle() = false;
  settings.policy() = p.options.agent.c_str();
  settings.update() = p.progress.updates;
}

bool Trainer::full(int environment) const { return parts_->collector->full(environment); }

bool Trainer::ready() const { return parts_->collector->ready(); }

// Acting.

bool Trainer::act(int environment, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  return parts_->collector->act(environment, observation, parts_->learner->parameters(), choice);
}

void Trainer::resume(int environment, std::vector<std::uint8_t>& choice) {
  parts_->collector->resume(environment, parts_->learner->parameters(), choice);
}

// Learning.

void Trainer::come_to(double share) { parts_->learner->come_to(share); }

UpdateFigures Trainer::update() {
  Collector& collector = *parts_->collector;
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

UpdateFigures Trainer::learn(std::span<Rollout* const> rollouts, std::span<const FinishedEpisode> finished) {
  Parts& p = *parts_;
  for (Rollout* rollout : rollouts) {
    rollout->max_steps = p.lesson().max_steps;
    p.progress.steps += rollout->action.size();
  }
  const UpdateFigures figures = p.learner->update(rollouts);
  ++p.progress.updates;
  for (const int id : p.collector->environments()) p.collector->begin_segment(id);
  p.count_episodes(finished);
  return figures;
}

void Trainer::Parts::count_episodes(std::span<const FinishedEpisode> finished) {
  double rewards = 0;
  for (const FinishedEpisode& episode : finished) {
    ++progress.episodes;
    rewards += episode.reward;
    if (recent.size() < kRecent) recent.emplace_back();
    recent[recent_next] = {episode.reward, episode.spl};
    recent_next = (recent_next + 1) % kRecent;
    progress.reward = progress.spl = 0;
    for (const auto& [reward, spl] : recent) {
      progress.reward += reward / static_cast<double>(recent.size());
      progress.spl += spl / static_cast<double>(recent.size());
    }
    if (recent.size() == kRecent && progress.spl >= kNavigates && !progress.episodes_to_spl95) {
      progress.episodes_to_spl95 = progress.episodes;
      progress.steps_to_spl95 = progress.steps;
    }
  }
  if (finished.empty()) return;
  progress.smoothed_reward = 0.25 * rewards / static_cast<double>(finished.size()) + 0.75 * progress.smoothed_reward;
  lesson_episodes += finished.size();
  if (progress.lesson + 1 == static_cast<int>(lessons.size()) || progress.smoothed_reward <= kLessonReward ||
      lesson_episodes < kLessonEpisodes)
    return;
  ++progress.lesson;
  lesson_episodes = 0;
  begin_cut();
}

// Checkpoints.

std::uint64_t Trainer::cut() const { return parts_->cut; }
const TrainingProgress& Trainer::progress() const { return parts_->progress; }
std::uint64_t Trainer::total_steps() const { return parts_->total_steps; }
bool Trainer::done() const { return parts_->progress.steps >= parts_->total_steps; }

/// What must be the same in a trainer that goes on.
nlohmann::json Trainer::Parts::identity() const {
  nlohmann::json identity = {{"agent", options.agent},
                             {"learner", options.learner},
                             {"network", network_parameters.values()},
                             {"learner_parameters", learner_parameters.values()},
                             {"trainer", trainer_parameters.values()},
                             {"seed", options.seed},
                             {"curriculum", options.curriculum},
                             {"task",
                              {{"features", task.features},
                               {"frames", task.frames},
                               {"first_frame", options.first_frame},
                               {"max_steps", options.max_steps}}}};
  if (!frozen.empty()) identity["frozen"] = frozen;
  return identity;
}

Checkpoint Trainer::checkpoint(const std::string& manifest) {
  Parts& p = *parts_;
  p.begin_cut();
  Checkpoint checkpoint;
  checkpoint.header = p.identity();
  LearnerState state;
  p.learner->save(state);
  for (auto& [name, tensor] : state.tensors) checkpoint.tensors["learner." + name] = std::move(tensor);
  checkpoint.tensors["reference"] = p.task.reference;
  if (!p.task.turns.empty()) checkpoint.header["turns"] = p.task.turns;
  nlohmann::json layout = nlohmann::json::array();
  for (const Tensor& tensor : p.network->tensors())
    layout.push_back({{"name", tensor.name}, {"rows", tensor.rows}, {"cols", tensor.cols}, {"offset", tensor.offset}});
  checkpoint.header["layout"] = layout;
  const auto optional = [](const std::optional<std::uint64_t>& value) {
    return value ? nlohmann::json(*value) : nlohmann::json();
  };
  checkpoint.header["progress"] = {{"updates", p.progress.updates},
                                   {"steps", p.progress.steps},
                                   {"episodes", p.progress.episodes},
                                   {"lesson", p.progress.lesson},
                                   {"lesson_episodes", p.lesson_episodes},
                                   {"smoothed_reward", p.progress.smoothed_reward},
                                   {"reward", p.progress.reward},
                                   {"spl", p.progress.spl},
                                   {"episodes_to_spl95", optional(p.progress.episodes_to_spl95)},
                                   {"steps_to_spl95", optional(p.progress.steps_to_spl95)},
                                   {"recent", p.recent},
                                   {"recent_next", p.recent_next},
                                   {"cut", p.cut}};
  checkpoint.header["counters"] = state.counters;
  if (!manifest.empty()) checkpoint.header["manifest"] = nlohmann::json::parse(manifest);
  return checkpoint;
}

void Trainer::load(const Checkpoint& checkpoint) {
  Parts& p = *parts_;
  const nlohmann::json identity = p.identity();
  // Also a checkpoint that has them goes on with them alone.
  if (identity.contains("frozen") != checkpoint.header.contains("frozen")) {
    const auto list = [](const nlohmann::json& header) {
      return header.value("frozen", nlohmann::json::array()).dump();
    };
    throw Error("frozen was " + list(checkpoint.header) + ", now it is " + list(identity), "checkpoint",
                "go on with the same options, or start a new run");
  }
  for (const auto& [key, wanted] : identity.items()) {
    const auto found = checkpoint.header.find(key);
    if (found == checkpoint.header.end()) throw Error("has no '" + key + "'", "checkpoint");
    if (*found == wanted) continue;
    std::string what = key, was = found->dump(), now = wanted.dump();
    if (wanted.is_object() && found->is_object())  // name the one that differs
      for (const auto& [inner, value] : wanted.items())
        if (!found->contains(inner) || found->at(inner) != value) {
          what = key + "." + inner;
          was = found->contains(inner) ? found->at(inner).dump() : "missing";
          now = value.dump();
          break;
        }
    throw Error(what + " was " + was + ", now it is " + now, "checkpoint",
                "go on with the same options, or start a new run");
  }
  const auto reference = checkpoint.tensors.find("reference");
  if (reference == checkpoint.tensors.end() || reference->second != p.task.reference)
    throw Error("the training route's features are others than those it was made with", "checkpoint",
                "go on with the same data, or start a new run");
  if (checkpoint.header.value("turns", nlohmann::json::array()) != nlohmann::json(p.task.turns))
    throw Error("the training route crosses itself elsewhere than the one it was made with", "checkpoint",
                "go on with the same data, or start a new run");
  try {
    const nlohmann::json& saved = checkpoint.header.at("progress");
    TrainingProgress progress;
    const auto number = [&](const char* name) {
      return saved.at(name).is_null() ? std::numeric_limits<double>::quiet_NaN() : saved.at(name).get<double>();
    };
    const auto optional = [&](const char* name) -> std::optional<std::uint64_t> {
      if (saved.at(name).is_null()) return std::nullopt;
      return saved.at(name).get<std::uint64_t>();
    };
    progress.updates = saved.at("updates").get<std::uint64_t>();
    progress.steps = saved.at("steps").get<std::uint64_t>();
    progress.episodes = saved.at("episodes").get<std::uint64_t>();
    progress.lesson = saved.at("lesson").get<int>();
    progress.smoothed_reward = number("smoothed_reward");
    progress.reward = number("reward");
    progress.spl = number("spl");
    progress.episodes_to_spl95 = optional("episodes_to_spl95");
    progress.steps_to_spl95 = optional("steps_to_spl95");
    const auto lesson_episodes = saved.at("lesson_episodes").get<std::uint64_t>();
    auto recent = saved.at("recent").get<std::vector<std::array<double, 2>>>();
    const auto recent_next = saved.at("recent_next").get<std::size_t>();
    const auto cut = saved.at("cut").get<std::uint64_t>();
    if (progress.lesson < 0 || progress.lesson >= static_cast<int>(p.lessons.size()) || recent.size() > kRecent ||
        recent_next >= kRecent)
      throw Error("its progress makes no sense", "checkpoint");
    LearnerState state;
    state.counters = checkpoint.header.at("counters").get<std::map<std::string, std::uint64_t>>();
    for (const auto& [name, tensor] : checkpoint.tensors)
      if (name.starts_with("learner.")) state.tensors[name.substr(8)] = tensor.reshaped();
    p.learner->load(state);
    p.progress = progress;
    p.lesson_episodes = lesson_episodes;
    p.recent = std::move(recent);
    p.recent_next = recent_next;
    p.cut = cut;
  } catch (const nlohmann::json::exception& problem) {
    throw Error("the header lacks something: " + std::string(problem.what()), "checkpoint");
  }
  p.collector->begin_cut(p.cut, p.lesson().frames);
}

const Vector<float>& Trainer::network_parameters() const { return parts_->learner->parameters(); }

int Trainer::batch() const {
  const Parts& p = *parts_;
  return p.trainer_parameters.integer("agents") * (p.segment / p.sequence);
}

void Trainer::describe(msg::LearnerInfo& info) const {
  const Parts& p = *parts_;
  info.agent() = p.options.agent.c_str();
  std::string text;
  for (const auto& [name, value] : p.network_parameters.values())
    text += (text.empty() ? "" : " ") + name + "=" + nlohmann::json(value).dump();
  info.network() = text.c_str();
  info.seed() = p.options.seed;
  info.feature_dimension() = static_cast<std::uint32_t>(p.task.features);
  info.first_frame() = static_cast<std::uint32_t>(p.options.first_frame);
  info.frames() = static_cast<std::uint32_t>(p.task.frames);
  info.lesson() = static_cast<std::uint32_t>(p.progress.lesson);
  info.lesson_frames() = static_cast<std::uint32_t>(p.lesson().frames);
  info.max_steps() = static_cast<std::uint32_t>(p.lesson().max_steps);
  info.steps() = static_cast<std::uint32_t>(p.sequence);
  info.noise_frame() = p.trainer_parameters["noise-frame"];
  info.noise_place() = p.trainer_parameters["noise-place"];
  info.noise_episode() = p.trainer_parameters["noise-episode"];
}

TrainedAgent Trainer::agent() const {
  const Parts& p = *parts_;
  return {p.options.agent,   p.task, p.options.first_frame, p.shared_network, p.learner->parameters(),
          p.progress.updates};
}

std::map<std::string, std::map<std::string, double>> Trainer::parameters() const {
  const Parts& p = *parts_;
  return {{"network", p.network_parameters.values()},
          {"learner", p.learner_parameters.values()},
          {"trainer", p.trainer_parameters.values()}};
}

std::map<std::string, std::map<std::string, double>> Trainer::recommended_parameters(const std::string& agent,
                                                                                     const std::string& learner) {
  TrainerOptions options;
  options.agent = agent;
  options.learner = learner;
  const Choices chosen = choose(options);
  return {{"network", chosen.network_parameters.values()},
          {"learner", chosen.learner_parameters.values()},
          {"trainer", chosen.trainer_parameters.values()}};
}

}  // namespace citylearn
