// SPDX-License-Identifier: Apache-2.0
#include "policy_service/learning/optimization/replay.h"

#include <algorithm>

#include "core/task/action.h"
#include "core/util/error.h"

namespace citylearn {

void Replay::add(std::span<Rollout* const> rollouts) {
  const Rollout& model = *rollouts[0];
  make_room(model.inputs.features.rows(), model.sequence);
  if (frames_ != model.inputs.frames || max_steps_ != model.max_steps) size_ = next_ = 0;
  frames_ = model.inputs.frames;
  max_steps_ = model.max_steps;
  for (std::size_t r = 0; r < rollouts.size(); ++r)
    for (int i = 0; i < rollouts[r]->sequences(); ++i)
      add(Track(rollouts, {static_cast<std::uint32_t>(r), static_cast<std::uint32_t>(i)}));
}

void Replay::save(LearnerState& state) const {
  state.counters["replay.size"] = size_;
  state.counters["replay.next"] = next_;
  state.counters["replay.frames"] = static_cast<std::uint64_t>(frames_);
  state.counters["replay.max_steps"] = static_cast<std::uint64_t>(max_steps_);
  state.counters["replay.sequence"] = static_cast<std::uint64_t>(sequence_);
  const std::size_t count = size_ * static_cast<std::size_t>(sequence_ + 1);
  state.tensors["replay.features"] = features_.leftCols(static_cast<std::ptrdiff_t>(count)).reshaped();
  Vector<float>& rest = state.tensors["replay.steps"];
  rest.resize(static_cast<std::ptrdiff_t>(kNumbers * count));
  for (std::size_t i = 0; i < count; ++i)
    rest.segment<kNumbers>(static_cast<std::ptrdiff_t>(kNumbers * i)) << static_cast<float>(shown_[i]),
        static_cast<float>(position_[i]), static_cast<float>(allowed_[i]), static_cast<float>(action_[i]),
        static_cast<float>(ended_[i]), log_probability_[i];
}

void Replay::check(const LearnerState& state, const std::string& owner, const NetworkTask& task) const {
  for (const char* name : {"replay.size", "replay.next", "replay.frames", "replay.max_steps", "replay.sequence"}) {
    if (!state.counters.contains(name)) throw Error("has no counter '" + std::string(name) + "'", owner);
    if (state.counters.at(name) > kMaxSteps) throw Error("counter '" + std::string(name) + "' is too large", owner);
  }
  for (const char* name : {"replay.features", "replay.steps"})
    if (!state.tensors.contains(name)) throw Error("has no tensor '" + std::string(name) + "'", owner);
  const std::uint64_t size = state.counters.at("replay.size"), length = state.counters.at("replay.sequence") + 1;
  const std::uint64_t frames = state.counters.at("replay.frames"), max_steps = state.counters.at("replay.max_steps");
  if (size == 0) return;
  if (length < 2 || size > slots(static_cast<int>(length) - 1) ||
      state.counters.at("replay.next") >= slots(static_cast<int>(length) - 1) || max_steps < 1 || frames < 2 ||
      frames > static_cast<std::uint64_t>(task.frames))
    throw Error("its replay of " + std::to_string(size) + " sequences makes no sense", owner);
  const auto require = [&](const char* name, std::uint64_t numbers) {
    const auto found = static_cast<std::uint64_t>(state.tensors.at(name).size());
    if (found != size * length * numbers)
      throw Error("tensor '" + std::string(name) + "' has " + std::to_string(found) + " numbers, not " +
                      std::to_string(size * length * numbers),
                  owner);
    if (!state.tensors.at(name).allFinite())
      throw Error("tensor '" + std::string(name) + "' has numbers that are none", owner);
  };
  require("replay.features", static_cast<std::uint64_t>(task.features));
  require("replay.steps", kNumbers);
  const Vector<float>& steps = state.tensors.at("replay.steps");
  const auto within = [&](std::ptrdiff_t at, int least, int most) {
    return steps(at) >= static_cast<float>(least) && steps(at) <= static_cast<float>(most);
  };
  const int last_place = static_cast<int>(frames) - 1;
  const int last_shown = static_cast<int>(frames) * task.experiences() - 1;
  const int first_shown = task.streets ? -1 - static_cast<int>(frames) : -1;
  for (std::ptrdiff_t i = 0; i < steps.size(); i += kNumbers) {
    const bool acts = (i / kNumbers + 1) % static_cast<std::ptrdiff_t>(length) != 0;
    if (!within(i, first_shown, last_shown) || !within(i + 1, 0, last_place) ||
        !within(i + 2, 1, (1 << kActions) - 1) || !within(i + 3, 0, acts ? kActions - 1 : kNoAction) ||
        !within(i + 4, 0, Rollout::kTruncated))
      throw Error("its replay makes no sense at step " + std::to_string(i / kNumbers), owner);
  }
}

void Replay::load(const LearnerState& state, int features) {
  size_ = state.counters.at("replay.size");
  next_ = state.counters.at("replay.next");
  frames_ = static_cast<int>(state.counters.at("replay.frames"));
  max_steps_ = static_cast<int>(state.counters.at("replay.max_steps"));
  if (size_ == 0) return;
  make_room(features, static_cast<int>(state.counters.at("replay.sequence")));
  const std::size_t count = size_ * static_cast<std::size_t>(sequence_ + 1);
  features_.leftCols(static_cast<std::ptrdiff_t>(count)).reshaped() = state.tensors.at("replay.features");
  const Vector<float>& steps = state.tensors.at("replay.steps");
  for (std::size_t i = 0; i < count; ++i) {
    const auto numbers = steps.segment<kNumbers>(static_cast<std::ptrdiff_t>(kNumbers * i));
    shown_[i] = static_cast<int>(numbers(0));
    position_[i] = static_cast<int>(numbers(1));
    allowed_[i] = static_cast<std::uint8_t>(numbers(2));
    action_[i] = static_cast<std::uint8_t>(numbers(3));
    ended_[i] = static_cast<std::uint8_t>(numbers(4));
    log_probability_[i] = numbers(5);
  }
}

void Replay::make_room(std::ptrdiff_t features, int sequence) {
  if (features == features_.rows() && sequence == sequence_) return;
  sequence_ = sequence;
  size_ = std::min(size_, slots(sequence));
  const std::size_t count = slots(sequence) * static_cast<std::size_t>(sequence + 1);
  features_.resize(features, static_cast<std::ptrdiff_t>(count));
  for (std::vector<int>* part : {&shown_, &position_}) part->resize(count);
  for (std::vector<std::uint8_t>* part : {&allowed_, &action_, &ended_}) part->resize(count);
  log_probability_.resize(count);
}

void Replay::add(const Track& track) {
  for (int t = 0; t <= sequence_; ++t) {
    const std::size_t to = at(next_, t);
    const Track::Seen seen = track.seen(t);
    const auto from = static_cast<std::size_t>(seen.column);
    features_.col(static_cast<std::ptrdiff_t>(to)) = seen.inputs.features_of(seen.column);
    shown_[to] = seen.inputs.shown[from];
    position_[to] = seen.inputs.position[from];
    allowed_[to] = seen.inputs.allowed[from];
    const auto step = static_cast<std::size_t>(track.column(t));
    const bool acts = t < sequence_;
    action_[to] = acts ? track.rollout().action[step] : static_cast<std::uint8_t>(kNoAction);
    ended_[to] = acts ? track.rollout().ended[step] : static_cast<std::uint8_t>(Rollout::kGoesOn);
    log_probability_[to] = acts ? track.rollout().log_probability[step] : 0.0f;
  }
  next_ = (next_ + 1) % slots(sequence_);
  size_ = std::min(size_ + 1, slots(sequence_));
}

}  // namespace citylearn
