// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/network_policy.h"

#include <cmath>

#include "core/util/error.h"
#include "policy_service/rollout/belief.h"

namespace citylearn {

std::uint8_t sample_action(const Eigen::Ref<const Eigen::Vector3f>& logits, Random& random, float& log_probability) {
  const Eigen::Array3d shifted = logits.cast<double>().array() - static_cast<double>(logits.maxCoeff());
  const Eigen::Array3d weights = shifted.exp();
  const double sum = weights.sum();
  double left = random.uniform() * sum;
  int action = 0;
  for (int i = 0; i < kActions; ++i) {
    if (weights(i) <= 0) continue;
    action = i;
    left -= weights(i);
    if (left < 0) break;
  }
  log_probability = static_cast<float>(shifted(action) - std::log(sum));
  return static_cast<std::uint8_t>(action);
}

void read_observation(const msg::Observation& observation, const NetworkTask& task, int first_frame, int frames,
                      bool own, NetworkInputs<float>& inputs, std::span<const int> who, int experience) {
  const int features = task.features;
  const std::size_t agents = observation.goal().size();
  if (observation.feature_dimension() != static_cast<std::uint32_t>(features))
    throw Error(
        "is " + std::to_string(observation.feature_dimension()) + ", the agent needs " + std::to_string(features),
        "Observation.feature_dimension of '" + std::string(observation.traversal().c_str()) + "'");
  if (observation.features().size() != agents * static_cast<std::size_t>(features))
    throw Error(
        "are " + std::to_string(observation.features().size()) + " numbers for " + std::to_string(agents) + " agents",
        "Observation.features");
  for (const std::size_t size :
       {observation.frame().size(), observation.position().size(), observation.allowed().size(),
        observation.previous_action().size(), observation.flags().size()})
    if (size != agents) throw Error("differ in length", "Observation's sequences");
  const std::size_t columns = who.empty() ? agents : who.size();
  inputs.resize(features, 1, static_cast<int>(columns));
  inputs.frames = frames;
  const auto place = [&](std::uint32_t frame, const char* field) {
    const std::int64_t found = std::int64_t{frame} - first_frame;
    if (found < 0 || found >= frames)
      throw Error("frame " + std::to_string(frame) + " is beside the route " + std::to_string(first_frame) + ".." +
                      std::to_string(first_frame + frames - 1),
                  "Observation." + std::string(field));
    return static_cast<int>(found);
  };
  for (std::size_t column = 0; column < columns; ++column) {
    if (!who.empty() && who[column] == EvaluatedTasks::kNobody) {
      inputs.goal[column] = inputs.position[column] = 0;
      inputs.previous_action[column] = static_cast<std::uint8_t>(kNoAction);
      inputs.allowed[column] = (1u << kActions) - 1;
      inputs.first[column] = 0;  // its state is zero, and a sparse belief need not look at all places for nobody
      inputs.see(static_cast<std::ptrdiff_t>(column), -1, Vector<float>::Zero(features));
      continue;
    }
    const std::size_t a = who.empty() ? column : static_cast<std::size_t>(who[column]);
    inputs.goal[column] = place(observation.goal()[a], "goal");
    inputs.position[column] = place(observation.position()[a], "position");
    inputs.previous_action[column] = observation.previous_action()[a];
    inputs.allowed[column] = observation.allowed()[a];
    if ((inputs.allowed[column] & ((1u << kActions) - 1)) == 0)
      throw Error("no action is allowed", "Observation.allowed");
    inputs.first[column] = (observation.flags()[a] & msg::FLAG_FIRST) != 0;
    const std::int64_t shown = std::int64_t{observation.frame()[a]} - first_frame;
    const Eigen::Map<const Vector<float>> numbers(
        observation.features().data() + a * static_cast<std::size_t>(features), features);
    inputs.see(static_cast<std::ptrdiff_t>(column),
               own                            ? NetworkInputs<float>::own(task, shown)
               : shown < 0 || shown >= frames ? -1
                                              : static_cast<int>(shown) + experience * frames,
               numbers);
  }
}

void add_beliefs(const AgentNetwork<float>& network, const Matrix<float>& states, int first_frame, msg::Belief& belief,
                 const StateMap* streets) {
  for (const auto& state : states.colwise())
    if (const Vector<float> scores = network.belief(state); scores.size() > 0)
      add_belief(scores, first_frame, belief, streets);
}

NetworkPolicy::NetworkPolicy(TrainedAgent agent, const Options& options)
    : agent_(std::move(agent)), options_(options), workspace_(agent_.network->make_workspace()) {
  if (agent_.network->normalises()) normaliser_ = FeatureNormaliser(agent_.task.reference);
  workspace_->fixed = 1;
}

void NetworkPolicy::act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  const std::size_t agents = observation.goal().size();
  choice.assign(agents, 0);
  tasks_.follow(observation);
  if (states_.cols() != static_cast<std::ptrdiff_t>(agents)) {
    states_.setZero(agent_.network->state_size(), static_cast<std::ptrdiff_t>(agents));
    random_.assign(agents, Random{options_.seed});
  }
  for (const EvaluatedTasks::Batch& batch : tasks_.batches()) act(observation, batch, choice);
}

void NetworkPolicy::act(const msg::Observation& observation, const EvaluatedTasks::Batch& batch,
                        std::vector<std::uint8_t>& choice) {
  const bool normalises = agent_.network->normalises();
  read_observation(observation, agent_.task, agent_.first_frame, agent_.task.frames, normalises, inputs_, batch);
  state_.setZero(states_.rows(), EvaluatedTasks::kColumns);
  EvaluatedTasks::each_agent(batch, [&](int column, int agent) {
    state_.col(column) = states_.col(agent);
    if (normalises) tasks_.normalise(normaliser_, agent, inputs_.features_of(column));
    if (inputs_.first[static_cast<std::size_t>(column)])
      random_[static_cast<std::size_t>(agent)] = Random{options_.seed, tasks_.task(agent)};
  });
  agent_.network->forward(agent_.parameters, inputs_, state_, *workspace_);
  EvaluatedTasks::each_agent(batch, [&](int column, int agent) {
    const auto a = static_cast<std::size_t>(agent);
    states_.col(agent) = workspace_->state.col(column);
    const auto logits = workspace_->heads.logits.col(column);
    float log_probability = 0;
    std::ptrdiff_t likeliest = 0;
    if (options_.greedy)
      logits.maxCoeff(&likeliest);
    else
      likeliest = sample_action(logits, random_[a], log_probability);
    choice[a] = static_cast<std::uint8_t>(likeliest);
  });
}

void NetworkPolicy::believe(msg::Belief& belief) const {
  add_beliefs(*agent_.network, states_, agent_.first_frame, belief, agent_.task.streets.get());
}

}  // namespace citylearn
