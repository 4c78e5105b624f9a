#include "policy_service/agent_network.h"

#include <algorithm>

namespace citylearn {

template <class S>
void NetworkInputs<S>::resize(int feature_dimension, int step_count, int agent_count) {
  steps = step_count;
  agents = agent_count;
  const std::size_t columns = static_cast<std::size_t>(step_count) * static_cast<std::size_t>(agent_count);
  features.resize(feature_dimension, static_cast<std::ptrdiff_t>(columns));
  goal.resize(columns);
  position.resize(columns);
  previous_action.resize(columns);
  allowed.resize(columns);
  first.resize(columns);
}

template <class S>
void NetworkInputs<S>::copy_column(const NetworkInputs& source, std::ptrdiff_t from, std::ptrdiff_t to) {
  features.col(to) = source.features.col(from);
  const auto f = static_cast<std::size_t>(from), t = static_cast<std::size_t>(to);
  goal[t] = source.goal[f];
  position[t] = source.position[f];
  previous_action[t] = source.previous_action[f];
  allowed[t] = source.allowed[f];
  first[t] = source.first[f];
}

template struct NetworkInputs<float>;
template struct NetworkInputs<double>;

}  // namespace citylearn
