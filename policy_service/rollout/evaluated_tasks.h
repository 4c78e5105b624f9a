// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <vector>

#include "core/wire/messages.h"
#include "policy_service/network/feature_normaliser.h"

namespace citylearn {

/// Tracks which tasks the agents of one env_service perform, for a Policy. Ensures that what an agent does depends on
/// its task alone and not on the agents beside it. Without begin() nobody numbers the tasks: then what was seen in
/// those that have ended, by any agent, is known to the later ones. Used by one thread.
class EvaluatedTasks {
 public:
  /// Agents are computed together in matrices of so many columns. A task always has the same column, because the place
  /// of a column in a matrix, and the matrix's width, may decide the last bit of a sum.
  static constexpr int kColumns = 16;
  static constexpr int kNobody = -1;
  using Batch = std::array<int, kColumns>;  ///< agents by column, or kNobody

  /// Does what Policy::begin() says.
  void begin(std::uint32_t first_task, const SeenFeatures& known);
  /// Takes in which agents begin a task, and which are idle. Call it once for each observation.
  void follow(const msg::Observation& observation);
  /// Returns all agents that are not idle, divided into as few batches as their columns allow. Valid until follow().
  const std::vector<Batch>& batches() const { return batches_; }
  /// Calls visit(column, agent) for each agent of a batch.
  template <class Visit>
  static void each_agent(const Batch& batch, Visit visit) {
    for (int column = 0; column < kColumns; ++column)
      if (const int agent = batch[static_cast<std::size_t>(column)]; agent != kNobody) visit(column, agent);
  }
  std::uint32_t task(int agent) const { return agents_[static_cast<std::size_t>(agent)].task; }
  /// Takes in what an agent sees, D numbers, and normalises it by what was seen in its task and in earlier ones.
  void normalise(const FeatureNormaliser& normaliser, int agent, Eigen::Ref<Vector<float>> features);
  /// Returns what the last normalise() normalised by.
  const SeenFeatures& total() const { return total_; }
  /// Returns what Policy::seen() says.
  const std::map<std::uint32_t, SeenFeatures>& seen() const { return seen_; }

 private:
  struct Agent {
    std::uint32_t task = 0;
    std::uint32_t begun = 0;       // tasks
    SeenFeatures* seen = nullptr;  // in its task; null before normalise()
  };

  bool numbered_ = false;  // by begin()
  std::uint32_t first_task_ = 0;
  SeenFeatures known_, total_;
  std::vector<Agent> agents_;
  std::vector<Batch> batches_;
  std::map<std::uint32_t, SeenFeatures> seen_;
  Vector<float> features_;
};

}  // namespace citylearn
