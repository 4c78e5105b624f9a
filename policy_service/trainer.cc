#include "policy_service/trainer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "policy_service/network_policy.h"
#include "policy_service/worker.h"

namespace citylearn {
namespace {

/// What a random stream is for. Further numbers of its name: environment, cut, and those given here.
enum Purpose : std::uint64_t {
  kEnvironment = 101,        // starts and goals
  kAction = 102,             // step
  kEpisodeAppearance = 103,  // agent, episode of the agent
  kFrameAppearance = 104,    // step, agent
};

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

struct FinishedEpisode {
  int tick = 0, agent = 0;
  double reward = 0, spl = 0;
};

/// Fills `out` with numbers of mean 0 and deviation 1, nearly normal: sums of four uniform ones, a draw of 64 bits
/// each.
void fill_noise(Random& random, Eigen::Ref<Vector<float>> out) {
  constexpr float kScale = 1.7320508f / 65536.0f;  // a uniform number of 16 bits has deviation 65536 / sqrt(12)
  for (float& value : out) {
    const std::uint64_t bits = random.next();
    const std::uint64_t sum = (bits & 0xFFFF) + (bits >> 16 & 0xFFFF) + (bits >> 32 & 0xFFFF) + (bits >> 48);
    value = (static_cast<float>(sum) - 131070.0f) * kScale;
  }
}

}  // namespace

struct Trainer::Parts {
  struct Agent {
    int start = 0, goal = 0, steps = 0;
    double reward = 0;
    std::uint64_t episode = 0;  // of this agent in this cut
    float strength = 0;         // of the episode's appearance
  };
  struct Half {  // of an environment's agents
    NetworkInputs<float> inputs;
    Matrix<float> state;
    std::unique_ptr<Workspace<float>> workspace;
  };
  struct Seat {
    int id = 0, agents = 0, tick = 0;
    std::uint64_t step = 0;  // of the next observation
    bool full = false;
    Rollout rollout;
    NetworkInputs<float> seen;  // the last observation, in the episode's appearance
    Matrix<float> state;        // before it
    Matrix<float> appearance;   // D x agents, of the episode
    std::vector<Agent> agent;
    std::vector<FinishedEpisode> finished;
    std::array<Half, 2> halves;
    Half single;  // for values of truncated episodes
  };

  TrainerOptions options;
  NetworkTask task;
  Parameters network_parameters, learner_parameters, trainer_parameters;
  std::unique_ptr<const AgentNetwork<float>> network;
  std::shared_ptr<const AgentNetwork<float>> shared_network;  // of agent()
  std::unique_ptr<Learner> learner;
  int segment = 0, sequence = 0;
  std::uint64_t total_steps = 0;
  float noise_frame = 0, noise_episode = 0;  // deviation of a component
  std::vector<Lesson> lessons;

  std::map<int, Seat> seats;
  std::uint64_t cut = 0;
  std::uint64_t generation = 1;  // of the parameters, for Workspace::fixed; a cut begins one, so that none outlives it
  TrainingProgress progress;
  std::uint64_t lesson_episodes = 0;          // finished in the present lesson
  std::vector<std::array<double, 2>> recent;  // reward and SPL of the last episodes, a ring
  std::size_t recent_next = 0;
  Vector<float> noise;  // of one frame
  Worker worker;

  bool disguises() const { return noise_episode > 0 || noise_frame > 0; }
  const Lesson& lesson() const { return lessons[static_cast<std::size_t>(progress.lesson)]; }
  Seat& seat(int environment) {
    const auto found = seats.find(environment);
    if (found == seats.end()) throw Error("environment " + std::to_string(environment) + " was never added", "trainer");
    return found->second;
  }

  void begin(Seat& seat) {
    seat.step = 0;
    seat.finished.clear();
    seat.agent.assign(static_cast<std::size_t>(seat.agents), Agent{});
    seat.state.setZero(network->state_size(), seat.agents);
    seat.appearance.setZero(task.features, seat.agents);
    begin_segment(seat);
  }
  void begin_segment(Seat& seat) {
    seat.full = false;
    seat.tick = 0;
    seat.rollout.max_steps = lesson().max_steps;
    for (NetworkInputs<float>* inputs : {&seat.rollout.inputs, &seat.rollout.next}) {
      inputs->resize(task.features, inputs->steps, inputs->agents);
      inputs->frames = lesson().frames;
    }
  }
  void begin_cut() {
    ++cut;
    ++generation;
    for (auto& [id, seat] : seats) begin(seat);
  }

  void check(const Seat& seat, const msg::Observation& observation) const;
  void end_action(Seat& seat, const msg::Observation& observation);
  float final_value(Seat& seat, std::ptrdiff_t agent, std::uint8_t action, int position, std::uint8_t allowed,
                    const Eigen::Ref<const Vector<float>>& features);
  void begin_episode(Seat& seat, std::size_t agent);
  void disguise(const Seat& seat, std::ptrdiff_t agent, Random& random, Eigen::Ref<Vector<float>> features);
  void evaluate(Seat& seat);
  void decide(Seat& seat, std::vector<std::uint8_t>& choice);
  void count_episodes();
  nlohmann::json identity() const;
};

// Construction.

std::vector<ParameterSpec> Trainer::parameter_specs() {
  return {{"segment", "steps of each agent between updates", 64, 1, 65536, true},
          {"sequence", "steps that gradients go back; divides the segment", 64, 1, 65536, true},
          {"steps", "environment steps of the whole run", 40000, 1, 1e12, true},
          {"agents", "agents to train with; fewer or more will do", 16, 1, msg::MAX_AGENTS, true},
          {"noise-frame", "length of the noise on each frame's features, in lengths of these", 1, 0, 100},
          {"noise-episode", "length of the shift of an episode's features, likewise", 3, 0, 100}};
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
  const double components = std::sqrt(std::max(1, task.features));
  p.noise_frame = static_cast<float>(p.trainer_parameters["noise-frame"] / components);
  p.noise_episode = static_cast<float>(p.trainer_parameters["noise-episode"] / components);
  p.lessons = {{task.frames, p.options.max_steps}};
  if (options.curriculum) p.lessons = curriculum_of(task.frames, p.options.max_steps);
  p.network = chosen.network->create(p.network_parameters, p.task);
  p.shared_network = chosen.network->create(p.network_parameters, p.task);
  p.learner = chosen.learner->create(
      p.learner_parameters,
      LearnerTask{*p.network, options.agent, p.network_parameters, p.task, options.seed, p.total_steps});
  p.progress.reward = p.progress.spl = std::numeric_limits<double>::quiet_NaN();
}

Trainer::~Trainer() = default;

// Environments.

void Trainer::add(int environment, int agents) {
  Parts& p = *parts_;
  if (agents < 1) throw Error("must be at least 1", "agents of environment " + std::to_string(environment));
  Parts::Seat& seat = p.seats[environment];
  seat.id = environment;
  seat.agents = agents;
  seat.rollout.resize(p.task.features, p.network->state_size(), p.segment, agents, p.sequence);
  const int middle = (agents + 1) / 2;
  for (int which = 0; which < 2; ++which) {
    Parts::Half& half = seat.halves[static_cast<std::size_t>(which)];
    const int count = which == 0 ? middle : agents - middle;
    half.inputs.agents = count;
    half.state.resize(p.network->state_size(), count);
    half.workspace = p.network->make_workspace();
  }
  seat.single.workspace = p.network->make_workspace();
  p.begin(seat);
}

void Trainer::remove(int environment) { parts_->seats.erase(environment); }

void Trainer::settings(int environment, msg::TaskSettings& settings) const {
  const Parts& p = *parts_;
  settings.task_mode() = msg::TRAIN;
  settings.lesson() = static_cast<std::uint32_t>(p.progress.lesson);
  settings.first_frame() = static_cast<std::uint32_t>(p.options.first_frame);
  settings.frames() = static_cast<std::uint32_t>(p.lesson().frames);
  settings.max_steps() = static_cast<std::uint32_t>(p.lesson().max_steps);
  settings.seed() = mix_seeds({p.options.seed, kEnvironment, static_cast<std::uint64_t>(environment), p.cut});
  settings.tasks() = 0;
  settings.shuffle() = false;
}

bool Trainer::full(int environment) const {
  const auto found = parts_->seats.find(environment);
  return found != parts_->seats.end() && found->second.full;
}

bool Trainer::ready() const {
  const auto& seats = parts_->seats;
  return !seats.empty() && std::all_of(seats.begin(), seats.end(), [](const auto& entry) { return entry.second.full; });
}

// Acting.

bool Trainer::act(int environment, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  Parts& p = *parts_;
  Parts::Seat& seat = p.seat(environment);
  if (seat.full) throw Error("its segment is full", "environment " + std::to_string(environment));
  p.check(seat, observation);
  const auto agents = static_cast<std::size_t>(seat.agents);
  read_observation(observation, p.task.features, p.options.first_frame, p.lesson().frames, p.disguises(), seat.seen);
  if (seat.step > 0) p.end_action(seat, observation);  // only now: what does not fit has changed nothing
  for (std::size_t agent = 0; agent < agents; ++agent) {
    if (seat.seen.first[agent]) p.begin_episode(seat, agent);
    Random random{p.options.seed, kFrameAppearance, static_cast<std::uint64_t>(seat.id), p.cut, seat.step, agent};
    const auto column = static_cast<std::ptrdiff_t>(agent);
    p.disguise(seat, column, random, seat.seen.features_of(column));
  }
  ++seat.step;
  p.evaluate(seat);
  if (seat.tick < p.segment) {
    p.decide(seat, choice);
    return true;
  }
  for (std::ptrdiff_t agent = 0; agent < seat.agents; ++agent) seat.rollout.next.copy_column(seat.seen, agent, agent);
  for (int which = 0, agent = 0; which < 2; ++which) {
    const auto& values = seat.halves[static_cast<std::size_t>(which)].workspace->heads.values;
    for (std::ptrdiff_t column = 0; column < values.cols(); ++column)
      seat.rollout.last_value[static_cast<std::size_t>(agent++)] = values(0, column);
  }
  seat.full = true;
  return false;
}

void Trainer::resume(int environment, std::vector<std::uint8_t>& choice) {
  Parts& p = *parts_;
  Parts::Seat& seat = p.seat(environment);
  if (seat.full || seat.step == 0 || seat.tick != 0)
    throw Error("no observation waits for an action", "environment " + std::to_string(environment));
  p.evaluate(seat);
  p.decide(seat, choice);
}

void Trainer::Parts::check(const Seat& seat, const msg::Observation& observation) const {
  const std::string where = "environment " + std::to_string(seat.id);
  if (observation.frame().size() != static_cast<std::size_t>(seat.agents) ||
      observation.reward().size() != static_cast<std::size_t>(seat.agents))
    throw Error(
        "has " + std::to_string(observation.frame().size()) + " agents, " + std::to_string(seat.agents) + " were added",
        where);
  if (observation.step() != seat.step)
    throw Error("sent step " + std::to_string(observation.step()) + " in the place of " + std::to_string(seat.step),
                where);
}

/// Reward and end of the action before this observation.
void Trainer::Parts::end_action(Seat& seat, const msg::Observation& observation) {
  const std::size_t agents = static_cast<std::size_t>(seat.agents);
  const std::size_t row = static_cast<std::size_t>(seat.tick - 1) * agents;
  Rollout& rollout = seat.rollout;
  for (std::size_t index = 0; index < agents; ++index) {
    Agent& agent = seat.agent[index];
    const std::uint8_t flags = observation.flags()[index];
    const float reward = observation.reward()[index];
    rollout.reward[row + index] = reward;
    ++agent.steps;
    agent.reward += reward;
    const bool terminated = flags & msg::FLAG_TERMINATED, truncated = flags & msg::FLAG_TRUNCATED;
    rollout.ended[row + index] = terminated ? Rollout::kTerminated : truncated ? Rollout::kTruncated : Rollout::kGoesOn;
    if (truncated) {
      // The agent stands where the episode was cut, so that the new observation shows what would have been seen next.
      const Eigen::Map<const Vector<float>> features(
          observation.features().data() + static_cast<std::ptrdiff_t>(index) * task.features, task.features);
      rollout.final_value[row + index] = final_value(
          seat, static_cast<std::ptrdiff_t>(index), rollout.action[row + index],
          static_cast<int>(observation.position()[index]) - options.first_frame, observation.allowed()[index], features);
    }
    if (!terminated && !truncated) continue;
    const double shortest = std::abs(agent.goal - agent.start);
    const double spl = terminated ? shortest / std::max<double>(shortest, agent.steps) : 0;
    seat.finished.push_back({seat.tick, static_cast<int>(index), agent.reward, spl});
  }
}

float Trainer::Parts::final_value(Seat& seat, std::ptrdiff_t agent, std::uint8_t action, int position,
                                  std::uint8_t allowed, const Eigen::Ref<const Vector<float>>& features) {
  NetworkInputs<float>& inputs = seat.single.inputs;
  inputs.resize(task.features, 1, 1);
  inputs.frames = lesson().frames;
  inputs.see(0, -1, features);
  inputs.position[0] = position;
  inputs.allowed[0] = allowed;
  inputs.goal[0] = seat.agent[static_cast<std::size_t>(agent)].goal;
  inputs.previous_action[0] = action;
  inputs.first[0] = 0;
  Random random{options.seed, kFrameAppearance, static_cast<std::uint64_t>(seat.id),
                cut,          seat.step,        static_cast<std::uint64_t>(agent)};
  disguise(seat, agent, random, inputs.features_of(0));
  seat.single.state = seat.state.col(agent);
  seat.single.workspace->fixed = generation;
  network->forward(learner->parameters(), inputs, seat.single.state, *seat.single.workspace);
  return seat.single.workspace->heads.values(0, 0);
}

void Trainer::Parts::begin_episode(Seat& seat, std::size_t index) {
  Agent& agent = seat.agent[index];
  agent.start = seat.seen.position[index];
  agent.goal = seat.seen.goal[index];
  agent.steps = 0;
  agent.reward = 0;
  ++agent.episode;
  if (!disguises()) return;
  Random random{options.seed, kEpisodeAppearance, static_cast<std::uint64_t>(seat.id), cut, index, agent.episode};
  agent.strength = static_cast<float>(random.uniform());
  fill_noise(random, seat.appearance.col(static_cast<std::ptrdiff_t>(index)));
}

/// x' = x + u f n + u e m, brought back to the length of x: n is noise of the frame, m and u are the episode's.
void Trainer::Parts::disguise(const Seat& seat, std::ptrdiff_t index, Random& random,
                              Eigen::Ref<Vector<float>> features) {
  if (!disguises()) return;
  const float length = features.norm(), strength = seat.agent[static_cast<std::size_t>(index)].strength * length;
  noise.resize(features.size());
  fill_noise(random, noise);
  features += strength * noise_frame * noise + strength * noise_episode * seat.appearance.col(index);
  const float changed = features.norm();
  if (changed > 0) features *= length / changed;
}

/// Runs the network on what the seat has seen; half of the agents on each thread.
void Trainer::Parts::evaluate(Seat& seat) {
  const auto run = [&](int which) {
    Half& half = seat.halves[static_cast<std::size_t>(which)];
    const std::ptrdiff_t count = half.inputs.agents, begin = which == 0 ? 0 : seat.agents - count;
    if (count == 0) return;
    half.inputs.resize(task.features, 1, static_cast<int>(count));
    half.inputs.frames = lesson().frames;
    for (std::ptrdiff_t agent = 0; agent < count; ++agent) half.inputs.copy_column(seat.seen, begin + agent, agent);
    half.state = seat.state.middleCols(begin, count);
    half.workspace->fixed = generation;
    network->forward(learner->parameters(), half.inputs, half.state, *half.workspace);
  };
  worker.both(run);
}

/// Draws actions and notes them, with all that the learner will want to know.
void Trainer::Parts::decide(Seat& seat, std::vector<std::uint8_t>& choice) {
  Rollout& rollout = seat.rollout;
  const std::ptrdiff_t agents = seat.agents, row = seat.tick * agents;
  if (seat.tick % sequence == 0) rollout.states.middleCols(seat.tick / sequence * agents, agents) = seat.state;
  Random random{options.seed, kAction, static_cast<std::uint64_t>(seat.id), cut, seat.step};
  choice.resize(static_cast<std::size_t>(agents));
  std::ptrdiff_t agent = 0;
  for (const Half& half : seat.halves) {
    for (std::ptrdiff_t column = 0; column < half.inputs.agents; ++column, ++agent) {
      const auto index = static_cast<std::size_t>(row + agent);
      rollout.inputs.copy_column(seat.seen, agent, row + agent);
      const std::uint8_t action =
          sample_action(half.workspace->heads.logits.col(column), random, rollout.log_probability[index]);
      rollout.action[index] = choice[static_cast<std::size_t>(agent)] = action;
      rollout.value[index] = half.workspace->heads.values(0, column);
      seat.state.col(agent) = half.workspace->state.col(column);
    }
  }
  ++seat.tick;
}

// Learning.

UpdateFigures Trainer::update() {
  Parts& p = *parts_;
  if (!ready()) throw Error("not every environment's segment is full", "trainer");
  std::vector<Rollout*> rollouts;
  for (auto& [id, seat] : p.seats) {
    rollouts.push_back(&seat.rollout);
    p.progress.steps += static_cast<std::uint64_t>(seat.agents) * static_cast<std::uint64_t>(p.segment);
  }
  const UpdateFigures figures = p.learner->update(rollouts);
  ++p.progress.updates;
  ++p.generation;
  for (auto& [id, seat] : p.seats) p.begin_segment(seat);
  p.count_episodes();
  return figures;
}

void Trainer::Parts::count_episodes() {
  std::vector<std::pair<std::array<int, 3>, FinishedEpisode>> all;
  for (auto& [id, seat] : seats) {
    for (const FinishedEpisode& episode : seat.finished) all.push_back({{episode.tick, id, episode.agent}, episode});
    seat.finished.clear();
  }
  std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  double rewards = 0;
  for (const auto& [order, episode] : all) {
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
  if (all.empty()) return;
  progress.smoothed_reward = 0.25 * rewards / static_cast<double>(all.size()) + 0.75 * progress.smoothed_reward;
  lesson_episodes += all.size();
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
  return {{"agent", options.agent},
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
  ++p.generation;
  for (auto& [id, seat] : p.seats) p.begin(seat);
}

TrainedAgent Trainer::agent() const {
  const Parts& p = *parts_;
  return {p.options.agent, p.task, p.options.first_frame, p.shared_network, p.learner->parameters()};
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
