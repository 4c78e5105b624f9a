// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/collector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "core/task/route_map.h"
#include "policy_service/rollout/network_policy.h"
#include "policy_service/rollout/worker.h"

namespace citylearn {
namespace {

/// What a random stream is for. Further numbers of its name: environment, cut, and those given here.
enum Purpose : std::uint64_t {
  kEnvironment = 101,        // starts and goals
  kAction = 102,             // step
  kEpisodeAppearance = 103,  // agent, episode of the agent
  kFrameAppearance = 104,    // step, agent
  kPlaceAppearance = 105,    // agent, episode of the agent, frame
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

struct Collector::Parts {
  struct Agent {
    int start = 0, goal = 0, shortest = 0, steps = 0;
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
    std::uint64_t generation = 0;  // of the parameters, for Workspace::fixed: a segment is acted by one
    Rollout rollout;
    NetworkInputs<float> seen;  // the last observation, in the episode's appearance
    Matrix<float> state;        // before it
    Matrix<float> appearance;   // D x agents, of the episode
    std::vector<Agent> agent;
    std::vector<FinishedEpisode> finished;
    std::array<Half, 2> halves;
    Half single;  // for values of truncated episodes
  };

  Parts(const CollectorOptions& how, const NetworkTask& what, const AgentNetwork<float>& who)
      : options(how), task(what), network(who), frames(what.frames) {
    const double components = std::sqrt(std::max(1, task.features));
    noise_frame = static_cast<float>(options.noise_frame / components);
    noise_place = static_cast<float>(options.noise_place / components);
    noise_episode = static_cast<float>(options.noise_episode / components);
  }

  const CollectorOptions options;
  const NetworkTask& task;
  const AgentNetwork<float>& network;
  float noise_frame, noise_place, noise_episode;  // deviation of a component
  std::map<int, Seat> seats;
  std::uint64_t cut = 0;
  int frames;           // places in use
  Vector<float> noise;  // of one frame
  std::vector<int> distances;
  Worker worker;

  bool disguises() const { return noise_frame > 0 || noise_place > 0 || noise_episode > 0; }
  Seat& seat(int environment) {
    const auto found = seats.find(environment);
    if (found == seats.end()) throw Error("environment " + std::to_string(environment) + " was never added", "trainer");
    return found->second;
  }

  void begin(Seat& seat) {
    seat.step = 0;
    seat.agent.assign(static_cast<std::size_t>(seat.agents), Agent{});
    seat.state.setZero(network.state_size(), seat.agents);
    seat.appearance.setZero(task.features, seat.agents);
    begin_segment(seat);
  }
  void begin_segment(Seat& seat) {
    ++seat.generation;
    seat.full = false;
    seat.tick = 0;
    seat.finished.clear();
    for (NetworkInputs<float>* inputs : {&seat.rollout.inputs, &seat.rollout.next}) {
      inputs->resize(task.features, inputs->steps, inputs->agents);
      inputs->frames = frames;
    }
  }

  void check(const Seat& seat, const msg::Observation& observation) const;
  void end_action(Seat& seat, const msg::Observation& observation, const Vector<float>& parameters);
  float final_value(Seat& seat, const Vector<float>& parameters, std::ptrdiff_t agent, std::uint8_t action,
                    int position, std::uint32_t frame, std::uint8_t allowed,
                    const Eigen::Ref<const Vector<float>>& features);
  void begin_episode(Seat& seat, std::size_t agent);
  void disguise(const Seat& seat, std::ptrdiff_t agent, std::uint32_t frame, Eigen::Ref<Vector<float>> features);
  void evaluate(Seat& seat, const Vector<float>& parameters);
  void decide(Seat& seat, std::vector<std::uint8_t>& choice);
};

Collector::Collector(const CollectorOptions& options, const NetworkTask& task, const AgentNetwork<float>& network)
    : parts_(std::make_unique<Parts>(options, task, network)) {}

Collector::~Collector() = default;

// Environments.

void Collector::begin_cut(std::uint64_t cut, int frames) {
  Parts& p = *parts_;
  p.cut = cut;
  p.frames = frames;
  for (auto& [id, seat] : p.seats) p.begin(seat);
}

void Collector::add(int environment, int agents) {
  Parts& p = *parts_;
  if (agents < 1) throw Error("must be at least 1", "agents of environment " + std::to_string(environment));
  Parts::Seat& seat = p.seats[environment];
  seat.id = environment;
  seat.agents = agents;
  seat.rollout.resize(p.task.features, p.network.state_size(), p.options.segment, agents, p.options.sequence);
  const int middle = (agents + 1) / 2;
  for (int which = 0; which < 2; ++which) {
    Parts::Half& half = seat.halves[static_cast<std::size_t>(which)];
    const int count = which == 0 ? middle : agents - middle;
    half.inputs.agents = count;
    half.state.resize(p.network.state_size(), count);
    half.workspace = p.network.make_workspace();
  }
  seat.single.workspace = p.network.make_workspace();
  p.begin(seat);
}

void Collector::remove(int environment) { parts_->seats.erase(environment); }

std::uint64_t Collector::environment_seed(int environment) const {
  return mix_seeds({parts_->options.seed, kEnvironment, static_cast<std::uint64_t>(environment), parts_->cut});
}

bool Collector::full(int environment) const {
  const auto found = parts_->seats.find(environment);
  return found != parts_->seats.end() && found->second.full;
}

bool Collector::ready() const {
  const auto& seats = parts_->seats;
  return !seats.empty() && std::all_of(seats.begin(), seats.end(), [](const auto& entry) { return entry.second.full; });
}

Rollout& Collector::rollout(int environment) { return parts_->seat(environment).rollout; }

const std::vector<FinishedEpisode>& Collector::finished(int environment) const {
  return parts_->seat(environment).finished;
}

void Collector::begin_segment(int environment) { parts_->begin_segment(parts_->seat(environment)); }

std::vector<int> Collector::environments() const {
  std::vector<int> found;
  for (const auto& [id, seat] : parts_->seats) found.push_back(id);
  return found;
}

// Acting.

bool Collector::act(int environment, const msg::Observation& observation, const Vector<float>& parameters,
                    std::vector<std::uint8_t>& choice) {
  Parts& p = *parts_;
  Parts::Seat& seat = p.seat(environment);
  if (seat.full) throw Error("its segment is full", "environment " + std::to_string(environment));
  p.check(seat, observation);
  const auto agents = static_cast<std::size_t>(seat.agents);
  read_observation(observation, p.task.features, p.options.first_frame, p.frames, p.disguises(), seat.seen);
  if (seat.step > 0) p.end_action(seat, observation, parameters);  // only now: what does not fit has changed nothing
  for (std::size_t agent = 0; agent < agents; ++agent) {
    if (seat.seen.first[agent]) p.begin_episode(seat, agent);
    const auto column = static_cast<std::ptrdiff_t>(agent);
    p.disguise(seat, column, observation.frame()[agent], seat.seen.features_of(column));
  }
  ++seat.step;
  p.evaluate(seat, parameters);
  if (seat.tick < p.options.segment) {
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

void Collector::resume(int environment, const Vector<float>& parameters, std::vector<std::uint8_t>& choice) {
  Parts& p = *parts_;
  Parts::Seat& seat = p.seat(environment);
  if (seat.full || seat.step == 0 || seat.tick != 0)
    throw Error("no observation waits for an action", "environment " + std::to_string(environment));
  p.evaluate(seat, parameters);
  p.decide(seat, choice);
}

void Collector::Parts::check(const Seat& seat, const msg::Observation& observation) const {
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
void Collector::Parts::end_action(Seat& seat, const msg::Observation& observation, const Vector<float>& parameters) {
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
      rollout.final_value[row + index] =
          final_value(seat, parameters, static_cast<std::ptrdiff_t>(index), rollout.action[row + index],
                      static_cast<int>(observation.position()[index]) - options.first_frame, observation.frame()[index],
                      observation.allowed()[index], features);
    }
    if (!terminated && !truncated) continue;
    const double shortest = agent.shortest;
    const double spl = terminated ? shortest / std::max<double>(shortest, agent.steps) : 0;
    seat.finished.push_back({seat.tick, static_cast<int>(index), agent.reward, spl});
  }
}

float Collector::Parts::final_value(Seat& seat, const Vector<float>& parameters, std::ptrdiff_t agent,
                                    std::uint8_t action, int position, std::uint32_t frame, std::uint8_t allowed,
                                    const Eigen::Ref<const Vector<float>>& features) {
  NetworkInputs<float>& inputs = seat.single.inputs;
  inputs.resize(task.features, 1, 1);
  inputs.frames = frames;
  inputs.see(0, -1, features);
  inputs.position[0] = position;
  inputs.allowed[0] = allowed;
  inputs.goal[0] = seat.agent[static_cast<std::size_t>(agent)].goal;
  inputs.previous_action[0] = action;
  inputs.first[0] = 0;
  disguise(seat, agent, frame, inputs.features_of(0));
  seat.single.state = seat.state.col(agent);
  seat.single.workspace->fixed = seat.generation;
  network.forward(parameters, inputs, seat.single.state, *seat.single.workspace);
  return seat.single.workspace->heads.values(0, 0);
}

void Collector::Parts::begin_episode(Seat& seat, std::size_t index) {
  Agent& agent = seat.agent[index];
  agent.start = seat.seen.position[index];
  agent.goal = seat.seen.goal[index];
  if (task.turns.empty()) {
    agent.shortest = std::abs(agent.goal - agent.start);
  } else {
    distances_to(agent.goal, task.frames, task.turns, distances);
    agent.shortest = distances[static_cast<std::size_t>(agent.start)];
  }
  agent.steps = 0;
  agent.reward = 0;
  ++agent.episode;
  if (!disguises()) return;
  Random random{options.seed, kEpisodeAppearance, static_cast<std::uint64_t>(seat.id), cut, index, agent.episode};
  agent.strength = static_cast<float>(random.uniform());
  fill_noise(random, seat.appearance.col(static_cast<std::ptrdiff_t>(index)));
}

/// x' = x + u (f n + p q + e m), brought back to the length of x. n is new at each look; q is the frame's and m the
/// episode's, so that a place looks the same however often an episode comes by; u, its strength, is the episode's too.
void Collector::Parts::disguise(const Seat& seat, std::ptrdiff_t index, std::uint32_t frame,
                                Eigen::Ref<Vector<float>> features) {
  if (!disguises()) return;
  const auto id = static_cast<std::uint64_t>(seat.id), number = static_cast<std::uint64_t>(index);
  const Agent& agent = seat.agent[number];
  const float length = features.norm(), strength = agent.strength * length;
  noise.resize(features.size());
  const auto add = [&](float part, Random random) {
    if (part <= 0) return;
    fill_noise(random, noise);
    features += strength * part * noise;
  };
  add(noise_frame, {options.seed, kFrameAppearance, id, cut, seat.step, number});
  add(noise_place, {options.seed, kPlaceAppearance, id, cut, number, agent.episode, frame});
  features += strength * noise_episode * seat.appearance.col(index);
  const float changed = features.norm();
  if (changed > 0) features *= length / changed;
}

/// Runs the network on what the seat has seen; half of the agents on each thread.
void Collector::Parts::evaluate(Seat& seat, const Vector<float>& parameters) {
  const auto run = [&](int which) {
    Half& half = seat.halves[static_cast<std::size_t>(which)];
    const std::ptrdiff_t count = half.inputs.agents, begin = which == 0 ? 0 : seat.agents - count;
    if (count == 0) return;
    half.inputs.resize(task.features, 1, static_cast<int>(count));
    half.inputs.frames = frames;
    for (std::ptrdiff_t agent = 0; agent < count; ++agent) half.inputs.copy_column(seat.seen, begin + agent, agent);
    half.state = seat.state.middleCols(begin, count);
    half.workspace->fixed = seat.generation;
    network.forward(parameters, half.inputs, half.state, *half.workspace);
  };
  worker.both(run);
}

/// Draws actions and notes them, with all that the learner will want to know.
void Collector::Parts::decide(Seat& seat, std::vector<std::uint8_t>& choice) {
  Rollout& rollout = seat.rollout;
  const std::ptrdiff_t agents = seat.agents, row = seat.tick * agents;
  if (seat.tick % options.sequence == 0)
    rollout.states.middleCols(seat.tick / options.sequence * agents, agents) = seat.state;
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

}  // namespace citylearn
