// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/belief.h"

#include <algorithm>
#include <numeric>
#include <set>

#include "idl/action.h"

namespace citylearn {

void add_belief(const Eigen::Ref<const Vector<float>>& scores, int first_frame, msg::Belief& belief,
                const StateMap* streets) {
  Vector<double> p = (scores.cast<double>().array() - static_cast<double>(scores.maxCoeff())).exp();
  if (!p.allFinite()) p.setOnes();  // a training that fails ends in the learner, not on the wire
  p /= p.sum();
  std::vector<std::ptrdiff_t> order(static_cast<std::size_t>(p.size()));
  std::iota(order.begin(), order.end(), 0);
  const auto likely = std::min<std::ptrdiff_t>(p.size(), msg::LIKELY_PLACES);
  std::partial_sort(order.begin(), order.begin() + likely, order.end(),
                    [&](std::ptrdiff_t a, std::ptrdiff_t b) { return p(a) != p(b) ? p(a) > p(b) : a < b; });
  const std::ptrdiff_t best = order.front();
  for (std::ptrdiff_t i = 0; i < msg::LIKELY_PLACES; ++i) {
    const std::ptrdiff_t place = i < likely ? order[static_cast<std::size_t>(i)] : best;
    belief.likely().push_back(static_cast<std::uint32_t>(first_frame + place));
    belief.probability().push_back(i < likely ? static_cast<float>(p(place)) : 0);
  }
  const double entropy = -(p.array() > 0).select(p.array() * p.array().log(), 0).sum() / std::log(2.0);
  double around = 0;
  if (streets) {
    const int state = static_cast<int>(best);
    const auto [first, last] = streets->before(state);
    std::set<int> near(first, last);
    near.insert(state);
    for (std::uint8_t action = 0; action < kActions; ++action)
      if (const int to = streets->next(state, action); to >= 0) near.insert(to);
    for (const int one : near) around += p(one);
  } else {
    const std::ptrdiff_t from = std::max<std::ptrdiff_t>(best - 1, 0), to = std::min(best + 2, p.size());
    around = p.segment(from, to - from).sum();
  }
  belief.entropy().push_back(static_cast<float>(std::max(entropy, 0.0)));
  belief.lost().push_back(static_cast<float>(std::max(1 - around, 0.0)));
}

}  // namespace citylearn
