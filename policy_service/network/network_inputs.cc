// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "policy_service/network/agent_network.h"

namespace citylearn {

template <class S>
void NetworkInputs<S>::resize(int feature_dimension, int step_count, int agent_count) {
  for (const int place : shown)
    if (place >= 0) column_of_[static_cast<std::size_t>(place)] = -1;
  steps = step_count;
  agents = agent_count;
  distinct = 0;
  if (features.rows() != feature_dimension) features.resize(feature_dimension, 0);
  const std::size_t columns = static_cast<std::size_t>(step_count) * static_cast<std::size_t>(agent_count);
  seen.assign(columns, -1);
  shown.assign(columns, -1);
  goal.resize(columns);
  position.resize(columns);
  previous_action.resize(columns);
  allowed.resize(columns);
  first.resize(columns);
}

template <class S>
void NetworkInputs<S>::see(std::ptrdiff_t column, int place, const Eigen::Ref<const Vector<S>>& numbers) {
  const auto index = static_cast<std::size_t>(column);
  shown[index] = place;
  if (place >= 0) {
    if (static_cast<std::size_t>(place) >= column_of_.size())
      column_of_.resize(static_cast<std::size_t>(place) + 1, -1);
    int& known = column_of_[static_cast<std::size_t>(place)];
    if (known >= 0) {
      seen[index] = known;
      return;
    }
    known = distinct;
  }
  if (distinct == features.cols())
    features.conservativeResize(Eigen::NoChange, std::max<std::ptrdiff_t>(16, 2 * features.cols()));
  seen[index] = distinct;
  features.col(distinct++) = numbers;
}

template <class S>
void NetworkInputs<S>::copy_column(const NetworkInputs& source, std::ptrdiff_t from, std::ptrdiff_t to) {
  const auto f = static_cast<std::size_t>(from), t = static_cast<std::size_t>(to);
  see(to, source.shown[f], source.features_of(from));
  goal[t] = source.goal[f];
  position[t] = source.position[f];
  previous_action[t] = source.previous_action[f];
  allowed[t] = source.allowed[f];
  first[t] = source.first[f];
}

template struct NetworkInputs<NetworkScalar>;

}  // namespace citylearn
