// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/trajectories.h"

#include <algorithm>
#include <cmath>

#include "core/task/goal_chain.h"
#include "core/task/spl.h"

namespace citylearn {

void TrajectoryShape::require_fits() const {
  const auto features_in_all = static_cast<std::uint64_t>(steps) * static_cast<std::uint64_t>(features);
  if (steps > static_cast<int>(msg::MAX_STEPS))
    throw Error("is " + std::to_string(steps) + ", actors send at most " + std::to_string(msg::MAX_STEPS) + " steps",
                "--trainer-sequence", "choose a shorter one");
  if (features_in_all > msg::MAX_FEATURES)
    throw Error(std::to_string(steps) + " steps of " + std::to_string(features) + " features are more than the " +
                    std::to_string(msg::MAX_FEATURES) + " numbers that a Trajectory holds",
                "--trainer-sequence", "at most " + std::to_string(msg::MAX_FEATURES / static_cast<unsigned>(features)));
  if (state_size > static_cast<int>(msg::MAX_STATE))
    throw Error("its recurrent state has " + std::to_string(state_size) + " numbers, actors send at most " +
                    std::to_string(msg::MAX_STATE),
                "--agent", "choose a smaller one, or --role both");
}

void pack(const Rollout& rollout, int agent, msg::Trajectory& trajectory) {
  const int steps = rollout.inputs.steps, agents = rollout.inputs.agents;
  const auto dimension = static_cast<std::size_t>(rollout.inputs.features.rows());
  const auto state = rollout.states.col(agent);
  trajectory.feature_dimension() = static_cast<std::uint32_t>(dimension);
  trajectory.state().assign(state.begin(), state.end());
  const auto per_observation = [&](auto& sequence) { sequence.resize(static_cast<std::size_t>(steps) + 1); };
  per_observation(trajectory.shown());
  per_observation(trajectory.position());
  per_observation(trajectory.goal());
  per_observation(trajectory.previous_action());
  per_observation(trajectory.allowed());
  per_observation(trajectory.first());
  per_observation(trajectory.value());
  trajectory.features().resize((static_cast<std::size_t>(steps) + 1) * dimension);
  trajectory.action().resize(static_cast<std::size_t>(steps));
  trajectory.log_probability().resize(static_cast<std::size_t>(steps));
  trajectory.reward().resize(static_cast<std::size_t>(steps));
  trajectory.ended().resize(static_cast<std::size_t>(steps));
  trajectory.final_value().resize(static_cast<std::size_t>(steps));
  for (int step = 0; step <= steps; ++step) {
    const NetworkInputs<float>& from = step < steps ? rollout.inputs : rollout.next;
    const auto f = static_cast<std::size_t>(step < steps ? step * agents + agent : agent);
    const auto t = static_cast<std::size_t>(step);
    trajectory.shown()[t] = from.shown[f];
    trajectory.position()[t] = static_cast<std::uint32_t>(from.position[f]);
    trajectory.goal()[t] = static_cast<std::uint32_t>(from.goal[f]);
    trajectory.previous_action()[t] = from.previous_action[f];
    trajectory.allowed()[t] = from.allowed[f];
    trajectory.first()[t] = from.first[f];
    trajectory.value()[t] = step < steps ? rollout.value[f] : rollout.last_value[f];
    const auto features = from.features_of(static_cast<std::ptrdiff_t>(f));
    std::copy(features.begin(), features.end(), trajectory.features().begin() + static_cast<long>(t * dimension));
    if (step == steps) continue;
    trajectory.action()[t] = rollout.action[f];
    trajectory.log_probability()[t] = rollout.log_probability[f];
    trajectory.reward()[t] = rollout.reward[f];
    trajectory.ended()[t] = rollout.ended[f];
    trajectory.final_value()[t] = rollout.ended[f] == Rollout::kTruncated ? rollout.final_value[f] : 0;
  }
}

TrajectoryQueue::TrajectoryQueue(const TrajectoryShape& shape, int capacity)
    : shape_(shape), fields_(*shape_.map), capacity_(static_cast<std::size_t>(capacity)) {}

void TrajectoryQueue::register_actor(const std::string& actor, std::uint64_t incarnation) {
  Actor& known = known_[actor];
  if (incarnation == known.incarnation) return;
  known = Actor();
  known.incarnation = incarnation;
  std::erase_if(episodes_, [&](const auto& entry) { return std::get<0>(entry.first) == actor; });
}

/// Returns how many more trajectories this actor may send.
std::size_t TrajectoryQueue::room(const Actor& actor) const {
  const std::size_t share = std::max<std::size_t>(1, capacity_ / static_cast<std::size_t>(std::max(1, actors_)));
  return share > actor.queued ? share - actor.queued : 0;
}

TrajectoryQueue::Window TrajectoryQueue::window(const std::string& actor) const {
  const auto found = known_.find(actor);
  if (found == known_.end()) return {};
  return {found->second.number, found->second.number + room(found->second)};
}

void TrajectoryQueue::check(const msg::Trajectory& trajectory, std::uint64_t version) const {
  const auto require = [](bool right, const char* field, const std::string& what) {
    if (!right) throw Error(what, "Trajectory." + std::string(field));
  };
  const auto is = [](std::size_t has, int should) {
    return "has " + std::to_string(has) + ", should be " + std::to_string(should);
  };
  const auto all_finite = [](const std::vector<float>& numbers) {
    return std::all_of(numbers.begin(), numbers.end(), [](float number) { return std::isfinite(number); });
  };
  const std::size_t steps = trajectory.action().size();
  require(steps == static_cast<std::size_t>(shape_.steps), "action", is(steps, shape_.steps));
  require(trajectory.feature_dimension() == static_cast<std::uint32_t>(shape_.features), "feature_dimension",
          is(trajectory.feature_dimension(), shape_.features));
  require(trajectory.state().size() == static_cast<std::size_t>(shape_.state_size), "state",
          is(trajectory.state().size(), shape_.state_size));
  require(trajectory.version() <= version, "version", "is newer than the newest");
  const auto frames = static_cast<std::uint32_t>(shape_.frames),
             places = static_cast<std::uint32_t>(shape_.map->places());
  for (std::size_t t = 0; t <= steps; ++t) {
    require(trajectory.position()[t] < frames, "position", "is beside the route");
    require(trajectory.goal()[t] < places, "goal", "is beside the route");
    require(trajectory.shown()[t] >= (shape_.map->line() ? -1 : -1 - shape_.frames) &&
                trajectory.shown()[t] < shape_.frames,
            "shown", "is beside the route");
    require((trajectory.allowed()[t] & ((1u << kActions) - 1)) != 0, "allowed", "no action is allowed");
    if (t < steps)
      require(trajectory.allowed()[t] >> trajectory.action()[t] & 1, "action", "one was taken that is not allowed");
  }
  require(all_finite(trajectory.features()), "features", "are not all finite");
  require(all_finite(trajectory.state()), "state", "is not all finite");
  require(all_finite(trajectory.value()), "value", "is not all finite");
  require(all_finite(trajectory.final_value()), "final_value", "is not all finite");
  require(all_finite(trajectory.log_probability()), "log_probability", "is not all finite");
  require(all_finite(trajectory.reward()), "reward", "is not all finite");
}

TrajectoryQueue::Taken TrajectoryQueue::take(msg::Trajectory& trajectory, std::uint64_t version) {
  const std::string actor = trajectory.header().sender().c_str();
  Actor& known = known_[actor];
  if (known.incarnation == 0) known.incarnation = trajectory.header().incarnation();
  const std::uint64_t number = trajectory.log().number(), never = trajectory.log().first() - 1;
  if (trajectory.header().incarnation() != known.incarnation) return Taken::kRepeated;
  if (never > known.number + room(known)) return Taken::kNoRoom;
  enqueue(actor, known, never);
  if (number <= known.number || known.early.contains(number)) return Taken::kRepeated;
  if (number > known.number + room(known)) return Taken::kNoRoom;
  check(trajectory, version);
  known.early.emplace(number, std::move(trajectory));
  enqueue(actor, known, known.number);
  return Taken::kTaken;
}

/// Queues what has come without a gap. No number up to `up_to` that is missing comes any more.
void TrajectoryQueue::enqueue(const std::string& actor, Actor& known, std::uint64_t up_to) {
  for (auto next = known.early.begin(); next != known.early.end() && next->first <= std::max(known.number, up_to) + 1;
       next = known.early.erase(next)) {
    follow(actor, next->second);
    known.number = next->first;
    queue_.push_back({actor, known.incarnation, std::move(next->second)});
    ++known.queued;
  }
  known.number = std::max(known.number, up_to);
}

/// Sums up the agent's episodes, which continue from one trajectory to the next.
void TrajectoryQueue::follow(const std::string& actor, const msg::Trajectory& trajectory) {
  Episode& episode = episodes_[{actor, trajectory.environment().c_str(), trajectory.agent()}];
  if (episode.settings != trajectory.settings() || episode.next_step != trajectory.step()) episode.known = false;
  episode.settings = trajectory.settings();
  episode.next_step = trajectory.step() + trajectory.action().size();
  for (std::size_t t = 0; t < trajectory.action().size(); ++t) {
    if (trajectory.first()[t]) {
      episode.known = true;
      episode.start = static_cast<int>(trajectory.position()[t]);
      episode.goals.clear();
      episode.steps = 0;
      episode.reward = 0;
    }
    if (const auto goal = static_cast<int>(trajectory.goal()[t]); episode.goals.empty() || episode.goals.back() != goal)
      episode.goals.push_back(goal);
    ++episode.steps;
    episode.reward += trajectory.reward()[t];
    if (trajectory.ended()[t] == Rollout::kGoesOn || !std::exchange(episode.known, false)) continue;
    const bool arrived = trajectory.ended()[t] == Rollout::kTerminated;
    finished_.push_back(
        {static_cast<int>(t) + 1, static_cast<int>(trajectory.agent()), episode.reward,
         spl_of(arrived, arrived ? fewest_steps(*shape_.map, fields_, 0, episode.start, episode.goals) : 0,
                episode.steps),
         episode.steps});
  }
}

/// Gives an entry's actor its room back.
void TrajectoryQueue::leave(const Entry& entry) {
  if (Actor& actor = known_[entry.actor]; actor.incarnation == entry.incarnation) --actor.queued;
}

bool TrajectoryQueue::ready(int count, std::uint64_t version, std::uint32_t lesson, std::uint64_t max_lag) {
  dropped_ += std::erase_if(queue_, [&](const Entry& entry) {
    const msg::Trajectory& trajectory = entry.trajectory;
    if (trajectory.lesson() == lesson && (max_lag == 0 || trajectory.version() + max_lag >= version)) return false;
    leave(entry);
    return true;
  });
  return queue_.size() >= static_cast<std::size_t>(count);
}

double TrajectoryQueue::assemble(int count, std::uint64_t version, int places, Rollout& rollout) {
  const int steps = shape_.steps;
  rollout.resize(shape_.features, shape_.state_size, steps, count, steps);
  rollout.inputs.frames = rollout.next.frames = places;
  double lag = 0;
  for (int agent = 0; agent < count; ++agent) {
    const msg::Trajectory& trajectory = queue_.front().trajectory;
    lag += static_cast<double>(version - trajectory.version()) / count;
    rollout.states.col(agent) = Eigen::Map<const Vector<float>>(trajectory.state().data(), shape_.state_size);
    for (int step = 0; step <= steps; ++step) {
      NetworkInputs<float>& to = step < steps ? rollout.inputs : rollout.next;
      const auto t = static_cast<std::size_t>(step);
      const auto k = static_cast<std::size_t>(step < steps ? step * count + agent : agent);
      to.see(static_cast<std::ptrdiff_t>(k), trajectory.shown()[t],
             Eigen::Map<const Vector<float>>(
                 trajectory.features().data() + t * static_cast<std::size_t>(shape_.features), shape_.features));
      to.position[k] = static_cast<int>(trajectory.position()[t]);
      to.goal[k] = static_cast<int>(trajectory.goal()[t]);
      to.previous_action[k] = trajectory.previous_action()[t];
      to.allowed[k] = trajectory.allowed()[t];
      to.first[k] = trajectory.first()[t];
      if (step == steps) {
        rollout.last_value[k] = trajectory.value()[t];
        continue;
      }
      rollout.value[k] = trajectory.value()[t];
      rollout.action[k] = trajectory.action()[t];
      rollout.log_probability[k] = trajectory.log_probability()[t];
      rollout.reward[k] = trajectory.reward()[t];
      rollout.ended[k] = trajectory.ended()[t];
      rollout.final_value[k] = trajectory.final_value()[t];
    }
    leave(queue_.front());
    queue_.pop_front();
  }
  return lag;
}

std::vector<FinishedEpisode> TrajectoryQueue::finished() { return std::exchange(finished_, {}); }

}  // namespace citylearn
