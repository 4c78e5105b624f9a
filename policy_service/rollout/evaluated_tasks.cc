// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/evaluated_tasks.h"

namespace citylearn {

void EvaluatedTasks::begin(std::uint32_t first_task, const SeenFeatures& known) {
  numbered_ = true;
  first_task_ = first_task;
  known_ = known;
  agents_.clear();
  seen_.clear();
}

void EvaluatedTasks::follow(const msg::Observation& observation) {
  const std::size_t count = observation.flags().size();
  if (agents_.size() != count) agents_.assign(count, {});
  batches_.clear();
  std::array<std::size_t, kColumns> taken{};
  for (std::size_t a = 0; a < count; ++a) {
    Agent& agent = agents_[a];
    if (observation.flags()[a] & msg::FLAG_IDLE) continue;
    if (agent.begun == 0 || observation.flags()[a] & msg::FLAG_FIRST) {
      if (agent.begun > 0 && !numbered_)
        if (const auto ended = seen_.extract(agent.task)) known_.add(ended.mapped());
      agent.task = first_task_ + static_cast<std::uint32_t>(a + count * agent.begun++);
      agent.seen = nullptr;
    }
    const std::size_t column = agent.task % kColumns, batch = taken[column]++;
    if (batch == batches_.size()) batches_.emplace_back().fill(kNobody);
    batches_[batch][column] = static_cast<int>(a);
  }
}

void EvaluatedTasks::normalise(const FeatureNormaliser& normaliser, int agent, Eigen::Ref<Vector<float>> features) {
  SeenFeatures*& own = agents_[static_cast<std::size_t>(agent)].seen;
  if (!own) own = &seen_[task(agent)];
  own->see(features);
  total_ = known_;
  total_.add(*own);
  // In memory of its own, because the order in which a vector's numbers are summed depends on where it begins.
  features_ = features;
  normaliser.apply(features_, total_);
  features = features_;
}

}  // namespace citylearn
