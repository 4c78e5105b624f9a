// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/collector.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/task/goal_chain.h"
#include "core/task/spl.h"
#include "policy_service/network/feature_normaliser.h"
#include "policy_service/rollout/network_policy.h"

namespace citylearn {
namespace {

/// Purpose of a random stream. Its name continues with environment and generation, then with the numbers given here.
enum Purpose : std::uint64_t {
  kEnvironment = 101,   // starts and goals
  kAction = 102,        // step
  kEpisodeNoise = 103,  // agent, episode of the agent
  kFrameNoise = 104,    // step, agent
  kPlaceNoise = 105,    // agent, episode of the agent, frame
};

constexpr double kMaxStretch = 5;  // of a place's noise, a power of two

/// Returns the number of pieces that so many agents are divided into. It decides bits, so threads play no part in it. A
/// piece reads all weights, which takes longer than a few agents do. One agent is one piece, which wakes no thread.
std::size_t pieces_for(std::size_t agents) {
  constexpr std::size_t kMinPieces = 2, kAgents = 16;  // kAgents: of a piece at most
  return std::max(std::min(kMinPieces, agents), (agents + kAgents - 1) / kAgents);
}

/// Fills `out` with nearly normal numbers of mean 0 and deviation 1: sums of four uniform ones from one 64-bit draw.
void fill_noise(Random& random, Eigen::Ref<Vector<float>> out) {
  constexpr float kScale = 1.7320508f / 65536.0f;  // a uniform number of 16 bits has deviation 65536 / sqrt(12)
  for (float& value : out) {
    const std::uint64_t bits = random.next();
    const std::uint64_t sum = (bits & 0xFFFF) + (bits >> 16 & 0xFFFF) + (bits >> 32 & 0xFFFF) + (bits >> 48);
    value = (static_cast<float>(sum) - 131070.0f) * kScale;
  }
}

}  // namespace

struct Collector::Impl {
  struct Agent {
    int start = 0, steps = 0;
    std::vector<int> goals;  // of its episode, up to the present one
    double reward = 0;
    std::uint64_t episode = 0;  // of this agent in this generation
    float strength = 0;         // of the episode's noise
    double stretch = 1;         // places over which a place's noise changes
  };
  struct Piece {  // of an environment's agents, from `begin` on
    std::ptrdiff_t begin = 0;
    NetworkInputs<float> inputs;
    Matrix<float> state;
    std::unique_ptr<Workspace<float>> workspace;
  };
  struct EnvState {
    int id = 0, agents = 0, experience = 0, tick = 0;
    std::uint64_t step = 0;  // of the next observation
    bool full = false;
    std::uint64_t parameter_generation = 0;  // of the parameters, for Workspace::fixed: a segment is acted by one
    Rollout rollout;
    NetworkInputs<float> seen;    // the last observation, with the noise of its episode
    Matrix<float> state;          // before it
    Matrix<float> episode_noise;  // D x agents, of the episode
    std::vector<Agent> agent;
    std::vector<FinishedEpisode> finished;
    std::vector<Piece> pieces;
    WorkerPool::PieceTime piece_time;
    Piece single;  // for values of truncated episodes
  };

  Impl(const CollectorOptions& how, const NetworkTask& what, const AgentNetwork<float>& who, WorkerPool& by)
      : options(how),
        task(what),
        network(who),
        workers(by),
        map(what.map()),
        fields(*map, what.goal_radius),
        frames(what.frames) {
    if (network.normalises()) normalisers = normalisers_by_experience(task.reference, task.frames);
    const double components = std::sqrt(std::max(1, task.features));
    noise_frame = static_cast<float>(options.noise_frame / components);
    noise_place = static_cast<float>(options.noise_place / components);
    noise_episode = static_cast<float>(options.noise_episode / components);
  }

  const CollectorOptions options;
  const NetworkTask& task;
  const AgentNetwork<float>& network;
  WorkerPool& workers;
  /// They see nothing: agents learn on the traversals that their priors are of. Empty: features stay as they are.
  std::vector<FeatureNormaliser> normalisers;
  float noise_frame, noise_place, noise_episode;  // deviation of a component
  const std::shared_ptr<const StateMap> map;
  DistanceFields fields;
  std::map<int, EnvState> envs;
  std::uint64_t generation = 0;
  int frames;           // places in use
  Vector<float> noise;  // of one frame

  bool augments() const { return noise_frame > 0 || noise_place > 0 || noise_episode > 0; }
  EnvState& env(int environment) {
    const auto found = envs.find(environment);
    if (found == envs.end()) throw Error("environment " + std::to_string(environment) + " was never added", "trainer");
    return found->second;
  }

  void begin(EnvState& env) {
    env.step = 0;
    env.agent.assign(static_cast<std::size_t>(env.agents), Agent{});
    env.state.setZero(network.state_size(), env.agents);
    env.episode_noise.setZero(task.features, env.agents);
    begin_segment(env);
  }
  void begin_segment(EnvState& env) {
    ++env.parameter_generation;
    env.full = false;
    env.tick = 0;
    env.finished.clear();
    for (NetworkInputs<float>* inputs : {&env.rollout.inputs, &env.rollout.next}) {
      inputs->resize(task.features, inputs->steps, inputs->agents);
      inputs->frames = frames;
    }
  }

  void normalise(const EnvState& env, Eigen::Ref<Matrix<float>> features) const {
    if (!normalisers.empty()) normalisers[static_cast<std::size_t>(env.experience)].apply(features);
  }

  void check(const EnvState& env, const msg::Observation& observation) const;
  void end_action(EnvState& env, const msg::Observation& observation, const Vector<float>& parameters);
  float final_value(EnvState& env, const Vector<float>& parameters, std::ptrdiff_t agent, std::uint8_t action,
                    int position, std::uint32_t frame, std::uint8_t allowed,
                    const Eigen::Ref<const Vector<float>>& features, bool reached);
  void begin_episode(EnvState& env, std::size_t agent);
  void augment_features(const EnvState& env, std::ptrdiff_t agent, std::uint32_t frame,
                        Eigen::Ref<Vector<float>> features);
  void evaluate(EnvState& env, const Vector<float>& parameters);
  void decide(EnvState& env, std::vector<std::uint8_t>& choice);
};

Collector::Collector(const CollectorOptions& options, const NetworkTask& task, const AgentNetwork<float>& network,
                     WorkerPool& workers)
    : impl_(std::make_unique<Impl>(options, task, network, workers)) {}

Collector::~Collector() = default;

// Environments.

void Collector::reset_all(std::uint64_t generation, int frames) {
  Impl& p = *impl_;
  p.generation = generation;
  p.frames = frames;
  for (auto& [id, env] : p.envs) p.begin(env);
}

void Collector::add(int environment, int agents, int experience) {
  Impl& p = *impl_;
  if (agents < 1) throw Error("must be at least 1", "agents of environment " + std::to_string(environment));
  if (p.task.features == 0) experience = 0;  // without features all experiences are alike
  if (experience < 0 || experience >= p.task.experiences())
    throw Error("is not known", "experience of environment " + std::to_string(environment));
  Impl::EnvState& env = p.envs[environment];
  env.id = environment;
  env.agents = agents;
  env.experience = experience;
  env.rollout.resize(p.task.features, p.network.state_size(), p.options.segment, agents, p.options.sequence);
  const auto count = static_cast<std::size_t>(agents);
  env.pieces.resize(pieces_for(count));
  for (std::size_t i = 0; i < env.pieces.size(); ++i) {
    Impl::Piece& piece = env.pieces[i];
    piece.begin = static_cast<std::ptrdiff_t>(begin_of_part(count, i, env.pieces.size()));
    const auto end = static_cast<std::ptrdiff_t>(begin_of_part(count, i + 1, env.pieces.size()));
    piece.inputs.agents = static_cast<int>(end - piece.begin);
    piece.state.resize(p.network.state_size(), end - piece.begin);
    piece.workspace = p.network.make_workspace();
  }
  env.single.workspace = p.network.make_workspace();
  p.begin(env);
}

void Collector::remove(int environment) { impl_->envs.erase(environment); }

std::uint64_t Collector::environment_seed(int environment) const {
  return mix_seeds({impl_->options.seed, kEnvironment, static_cast<std::uint64_t>(environment), impl_->generation});
}

bool Collector::full(int environment) const {
  const auto found = impl_->envs.find(environment);
  return found != impl_->envs.end() && found->second.full;
}

bool Collector::ready() const {
  const auto& envs = impl_->envs;
  return !envs.empty() && std::all_of(envs.begin(), envs.end(), [](const auto& entry) { return entry.second.full; });
}

Rollout& Collector::rollout(int environment) { return impl_->env(environment).rollout; }

const std::vector<FinishedEpisode>& Collector::finished(int environment) const {
  return impl_->env(environment).finished;
}

void Collector::begin_segment(int environment) { impl_->begin_segment(impl_->env(environment)); }

void Collector::believe(int environment, msg::Belief& belief) const {
  add_beliefs(impl_->network, impl_->env(environment).state, impl_->options.first_frame, belief,
              impl_->task.streets.get());
}

std::vector<int> Collector::environments() const {
  std::vector<int> found;
  for (const auto& [id, env] : impl_->envs) found.push_back(id);
  return found;
}

// Acting.

bool Collector::act(int environment, const msg::Observation& observation, const Vector<float>& parameters,
                    std::vector<std::uint8_t>& choice) {
  Impl& p = *impl_;
  Impl::EnvState& env = p.env(environment);
  if (env.full) throw Error("its segment is full", "environment " + std::to_string(environment));
  p.check(env, observation);
  const auto agents = static_cast<std::size_t>(env.agents);
  read_observation(observation, p.task, p.options.first_frame, p.frames, p.augments(), env.seen, {}, env.experience);
  p.normalise(env, env.seen.features.leftCols(env.seen.distinct));
  if (env.step > 0) p.end_action(env, observation, parameters);  // an observation that does not fit changes nothing
  for (std::size_t agent = 0; agent < agents; ++agent) {
    if (env.seen.first[agent]) p.begin_episode(env, agent);
    std::vector<int>& goals = env.agent[agent].goals;
    if (goals.empty() || goals.back() != env.seen.goal[agent]) goals.push_back(env.seen.goal[agent]);
    const auto column = static_cast<std::ptrdiff_t>(agent);
    p.augment_features(env, column, observation.frame()[agent], env.seen.features_of(column));
  }
  ++env.step;
  p.evaluate(env, parameters);
  if (env.tick < p.options.segment) {
    p.decide(env, choice);
    return true;
  }
  for (std::ptrdiff_t agent = 0; agent < env.agents; ++agent) env.rollout.next.copy_column(env.seen, agent, agent);
  for (const Impl::Piece& piece : env.pieces)
    for (std::ptrdiff_t column = 0; column < piece.inputs.agents; ++column)
      env.rollout.last_value[static_cast<std::size_t>(piece.begin + column)] = piece.workspace->heads.values(0, column);
  env.full = true;
  return false;
}

void Collector::resume(int environment, const Vector<float>& parameters, std::vector<std::uint8_t>& choice) {
  Impl& p = *impl_;
  Impl::EnvState& env = p.env(environment);
  if (env.full || env.step == 0 || env.tick != 0)
    throw Error("no observation waits for an action", "environment " + std::to_string(environment));
  p.evaluate(env, parameters);
  p.decide(env, choice);
}

void Collector::Impl::check(const EnvState& env, const msg::Observation& observation) const {
  const std::string where = "environment " + std::to_string(env.id);
  if (observation.frame().size() != static_cast<std::size_t>(env.agents) ||
      observation.reward().size() != static_cast<std::size_t>(env.agents))
    throw Error(
        "has " + std::to_string(observation.frame().size()) + " agents, " + std::to_string(env.agents) + " were added",
        where);
  if (observation.step() != env.step)
    throw Error("sent step " + std::to_string(observation.step()) + " in the place of " + std::to_string(env.step),
                where);
}

/// Records reward and end of the action before this observation.
void Collector::Impl::end_action(EnvState& env, const msg::Observation& observation, const Vector<float>& parameters) {
  const std::size_t agents = static_cast<std::size_t>(env.agents);
  const std::size_t row = static_cast<std::size_t>(env.tick - 1) * agents;
  Rollout& rollout = env.rollout;
  for (std::size_t index = 0; index < agents; ++index) {
    Agent& agent = env.agent[index];
    const std::uint8_t flags = observation.flags()[index];
    const float reward = observation.reward()[index];
    rollout.reward[row + index] = reward;
    ++agent.steps;
    agent.reward += reward;
    const bool terminated = flags & msg::FLAG_TERMINATED, truncated = flags & msg::FLAG_TRUNCATED;
    rollout.ended[row + index] = terminated ? Rollout::kTerminated : truncated ? Rollout::kTruncated : Rollout::kGoesOn;
    if (truncated) {
      // The agent stands where the episode was truncated, so that the new observation shows what would have been seen
      // next.
      const Eigen::Map<const Vector<float>> features(
          observation.features().data() + static_cast<std::ptrdiff_t>(index) * task.features, task.features);
      rollout.final_value[row + index] =
          final_value(env, parameters, static_cast<std::ptrdiff_t>(index), rollout.action[row + index],
                      static_cast<int>(observation.position()[index]) - options.first_frame, observation.frame()[index],
                      observation.allowed()[index], features, reward > 0);
    }
    if (!terminated && !truncated) continue;
    const double shortest = terminated ? fewest_steps(*map, fields, task.goal_radius, agent.start, agent.goals) : 0;
    const double spl = spl_of(terminated, shortest, agent.steps);
    env.finished.push_back({env.tick, static_cast<int>(index), agent.reward, spl, agent.steps});
  }
}

float Collector::Impl::final_value(EnvState& env, const Vector<float>& parameters, std::ptrdiff_t agent,
                                   std::uint8_t action, int position, std::uint32_t frame, std::uint8_t allowed,
                                   const Eigen::Ref<const Vector<float>>& features, bool reached) {
  NetworkInputs<float>& inputs = env.single.inputs;
  inputs.resize(task.features, 1, 1);
  inputs.frames = frames;
  inputs.see(0, NetworkInputs<float>::own(task, frame), features);
  inputs.position[0] = position;
  inputs.allowed[0] = allowed;
  // An agent that used its last step to reach a goal would have got another one: any, as that of the next episode.
  const auto index = static_cast<std::size_t>(agent);
  inputs.goal[0] = reached ? env.seen.goal[index] : env.agent[index].goals.back();
  inputs.previous_action[0] = action;
  inputs.first[0] = 0;
  normalise(env, inputs.features.leftCols(1));
  augment_features(env, agent, frame, inputs.features_of(0));
  env.single.state = env.state.col(agent);
  env.single.workspace->fixed = env.parameter_generation;
  network.forward(parameters, inputs, env.single.state, *env.single.workspace);
  return env.single.workspace->heads.values(0, 0);
}

void Collector::Impl::begin_episode(EnvState& env, std::size_t index) {
  Agent& agent = env.agent[index];
  agent.start = env.seen.position[index];
  agent.goals.clear();
  agent.steps = 0;
  agent.reward = 0;
  ++agent.episode;
  if (!augments()) return;
  Random random{options.seed, kEpisodeNoise, static_cast<std::uint64_t>(env.id), generation, index, agent.episode};
  agent.strength = static_cast<float>(random.uniform());
  agent.stretch = std::exp2(random.uniform() * kMaxStretch);
  fill_noise(random, env.episode_noise.col(static_cast<std::ptrdiff_t>(index)));
}

/// x' = x + u (f n + p q + e m), scaled back to the length of x. n is drawn at each step; q belongs to the frame and m
/// to the episode, so that a place looks the same all along an episode; u, the strength, belongs to the episode too.
/// Along the route q goes from one draw to the next in `stretch` places, because neighbouring frames err alike: an
/// agent that learned otherwise would be too sure of itself where all looks strange. On streets frames with
/// neighbouring numbers look from one place, or from two that a map lists one after the other: they may err alike as
/// well, and what is alike along a street hardly reaches beyond one place.
void Collector::Impl::augment_features(const EnvState& env, std::ptrdiff_t index, std::uint32_t frame,
                                       Eigen::Ref<Vector<float>> features) {
  if (!augments()) return;
  const auto id = static_cast<std::uint64_t>(env.id), number = static_cast<std::uint64_t>(index);
  const Agent& agent = env.agent[number];
  const float length = features.norm(), strength = agent.strength * length;
  noise.resize(features.size());
  const auto add = [&](float part, Random random) {
    if (part <= 0) return;
    fill_noise(random, noise);
    features += strength * part * noise;
  };
  add(noise_frame, {options.seed, kFrameNoise, id, generation, env.step, number});
  const double draw = std::floor(frame / agent.stretch);
  const auto past = static_cast<float>(frame / agent.stretch - draw);
  const float mixed = noise_place / std::hypot(1 - past, past);
  for (const int which : {0, 1})
    add(mixed * (which == 0 ? 1 - past : past), {options.seed, kPlaceNoise, id, generation, number, agent.episode,
                                                 static_cast<std::uint64_t>(draw) + static_cast<std::uint64_t>(which)});
  features += strength * noise_episode * env.episode_noise.col(index);
  const float changed = features.norm();
  if (changed > 0) features *= length / changed;
}

/// Runs the network on the last observation.
void Collector::Impl::evaluate(EnvState& env, const Vector<float>& parameters) {
  const auto run = [&](int which) {
    Piece& piece = env.pieces[static_cast<std::size_t>(which)];
    const std::ptrdiff_t count = piece.inputs.agents;
    if (count == 0) return;
    piece.inputs.resize(task.features, 1, static_cast<int>(count));
    piece.inputs.frames = frames;
    for (std::ptrdiff_t agent = 0; agent < count; ++agent)
      piece.inputs.copy_column(env.seen, piece.begin + agent, agent);
    piece.state = env.state.middleCols(piece.begin, count);
    piece.workspace->fixed = env.parameter_generation;
    network.forward(parameters, piece.inputs, piece.state, *piece.workspace);
  };
  workers.run(static_cast<int>(env.pieces.size()), std::cref(run), &env.piece_time);
}

/// Draws actions and records them, with all that the learner needs.
void Collector::Impl::decide(EnvState& env, std::vector<std::uint8_t>& choice) {
  Rollout& rollout = env.rollout;
  const std::ptrdiff_t agents = env.agents, row = env.tick * agents;
  if (env.tick % options.sequence == 0)
    rollout.states.middleCols(env.tick / options.sequence * agents, agents) = env.state;
  Random random{options.seed, kAction, static_cast<std::uint64_t>(env.id), generation, env.step};
  choice.resize(static_cast<std::size_t>(agents));
  std::ptrdiff_t agent = 0;
  for (const Piece& piece : env.pieces) {
    for (std::ptrdiff_t column = 0; column < piece.inputs.agents; ++column, ++agent) {
      const auto index = static_cast<std::size_t>(row + agent);
      rollout.inputs.copy_column(env.seen, agent, row + agent);
      const std::uint8_t action =
          sample_action(piece.workspace->heads.logits.col(column), random, rollout.log_probability[index]);
      rollout.action[index] = choice[static_cast<std::size_t>(agent)] = action;
      rollout.value[index] = piece.workspace->heads.values(0, column);
      env.state.col(agent) = piece.workspace->state.col(column);
    }
  }
  ++env.tick;
}

}  // namespace citylearn
