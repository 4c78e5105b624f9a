// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "policy_service/rollout/rollout.h"
#include "policy_service/rollout/worker_pool.h"

namespace citylearn {

/// Names a sequence of an update's rollouts, numbered as in Rollout.
struct Sequence {
  std::uint32_t rollout, index;
};

/// Finds a sequence's columns in its rollout.
class Track {
 public:
  Track(std::span<Rollout* const> rollouts, Sequence sequence)
      : rollout_(*rollouts[sequence.rollout]),
        index_(sequence.index),
        agents_(rollout_.inputs.agents),
        agent_(index_ % agents_),
        begin_(index_ / agents_ * rollout_.sequence) {}

  const Rollout& rollout() const { return rollout_; }
  /// Returns the recurrent state before the sequence, state_size numbers.
  auto state() const { return rollout_.states.col(index_); }
  /// Returns the column of step t, 0 <= t < L.
  std::ptrdiff_t column(std::ptrdiff_t t) const { return (begin_ + t) * agents_ + agent_; }
  /// Returns where to find what was seen at step t, 0 <= t <= L; the last was seen after the last action.
  struct Seen {
    const NetworkInputs<float>& inputs;
    std::ptrdiff_t column;
  };
  Seen seen(std::ptrdiff_t t) const {
    if (begin_ + t < rollout_.inputs.steps) return {rollout_.inputs, column(t)};
    return {rollout_.next, agent_};
  }

 private:
  const Rollout& rollout_;
  std::ptrdiff_t index_, agents_, agent_, begin_;
};

/// Lists all sequences of the rollouts, in their order.
inline void list_sequences(std::span<Rollout* const> rollouts, std::vector<Sequence>& sequences) {
  sequences.clear();
  for (std::size_t r = 0; r < rollouts.size(); ++r)
    for (int i = 0; i < rollouts[r]->sequences(); ++i)
      sequences.push_back({static_cast<std::uint32_t>(r), static_cast<std::uint32_t>(i)});
}

inline void shuffle(Random& random, std::vector<Sequence>& sequences) {
  for (std::size_t i = sequences.size() - 1; i > 0; --i) std::swap(sequences[i], sequences[random.below(i + 1)]);
}

/// Returns shard `which` of a minibatch in so many; it may be empty.
template <class T>
std::span<const T> shard_of(std::span<const T> chosen, std::size_t which, std::size_t shards) {
  const std::size_t begin = begin_of_part(chosen.size(), which, shards);
  return chosen.subspan(begin, begin_of_part(chosen.size(), which + 1, shards) - begin);
}

/// Returns part `batch` of `batches` parts of nearly equal size.
template <class T>
std::span<const T> part_of(const std::vector<T>& all, std::size_t batch, std::size_t batches) {
  const std::size_t begin = batch * all.size() / batches, end = (batch + 1) * all.size() / batches;
  return {all.data() + begin, end - begin};
}

}  // namespace citylearn
