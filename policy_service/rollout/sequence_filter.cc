// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <map>

#include "core/task/route_map.h"
#include "policy_service/rollout/control.h"

namespace citylearn {
namespace {

/// A Bayes filter over the places of the route, without anything learned: uniform at first, moved by the known action,
/// weighed by exp(-|x - x_ref|^2 / (2 sigma^2)) for each place's reference features, and zero at the goal while the
/// episode lasts. Walks to the heavier side of the goal; on a map, takes the step that leads nearer from where most of
/// the belief is.
class SequenceFilter : public Policy {
 public:
  SequenceFilter(const ControlTask& task, double sigma) : task_(task), sigma_(sigma) {
    if (task.reference.empty())
      throw Error("needs the features of the training traversal", "sequence_filter",
                  "start an env_service on a traversal that has features");
    check_turns(task.turns, task.frames);
  }

  void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) override {
    const std::size_t agents = observation.goal().size();
    if (static_cast<int>(observation.feature_dimension()) != task_.dimension)
      throw Error(std::to_string(observation.feature_dimension()) + " features, the reference has " +
                      std::to_string(task_.dimension),
                  "traversal " + std::string(observation.traversal().c_str()));
    belief_.resize(agents, std::vector<double>(task_.frames, 0.0));
    choice.resize(agents);
    for (std::size_t i = 0; i < agents; ++i) {
      const int goal = static_cast<int>(observation.goal()[i]) - task_.first_frame;
      std::vector<double>& belief = belief_[i];
      if (observation.flags()[i] & msg::FLAG_FIRST) {
        std::fill(belief.begin(), belief.end(), 0.0);
      } else if (observation.previous_action()[i] == kNext) {
        belief.insert(belief.begin(), kNever);
        belief.pop_back();
      } else if (observation.previous_action()[i] == kPrevious) {
        belief.erase(belief.begin());
        belief.push_back(kNever);
      } else if (!task_.turns.empty()) {
        turned_ = belief;
        for (std::size_t place = 0; place < turned_.size(); ++place)
          belief[static_cast<std::size_t>(task_.turns[place])] = turned_[place];
      }
      weigh(belief, observation.features().data() + i * task_.dimension);
      belief[goal] = kNever;
      const double top = *std::max_element(belief.begin(), belief.end());
      double before = 0, behind = 0;
      for (int place = 0; place < task_.frames; ++place) {
        belief[place] = std::max(belief[place] - top, kNever);
        (place < goal ? before : behind) += std::exp(belief[place]);
      }
      choice[i] = task_.turns.empty() ? allowed_or_turn(before > behind ? kNext : kPrevious, observation.allowed()[i])
                                      : on_the_map(belief, goal, observation.allowed()[i]);
    }
  }

 private:
  /// Of what is allowed, the step that most of the belief calls nearer to the goal.
  std::uint8_t on_the_map(const std::vector<double>& belief, int goal, std::uint8_t allowed) {
    std::vector<int>& distances = distances_[goal];
    if (distances.empty()) distances_to(goal, task_.frames, task_.turns, distances);
    std::uint8_t best = kStay;
    double most = -1;
    for (const std::uint8_t action : {kNext, kPrevious, kStay}) {
      if (!(allowed >> action & 1)) continue;
      double mass = 0;
      for (int place = 0; place < task_.frames; ++place) {
        const int to = place_after(place, action, task_.turns);
        if (to >= 0 && to < task_.frames && distances[to] < distances[place]) mass += std::exp(belief[place]);
      }
      if (mass > most) {
        best = action;
        most = mass;
      }
    }
    return best;
  }

  // Beliefs are logarithms. Nothing falls below this: a place once excluded by a bad frame can come back.
  static constexpr double kNever = -50.0;

  void weigh(std::vector<double>& belief, const float* features) const {
    const double scale = 1.0 / (2.0 * sigma_ * sigma_);
    for (int place = 0; place < task_.frames; ++place) {
      const float* reference = task_.reference.data() + static_cast<std::size_t>(place) * task_.dimension;
      float distance = 0;
      for (int k = 0; k < task_.dimension; ++k) {
        const float difference = features[k] - reference[k];
        distance += difference * difference;
      }
      belief[place] -= distance * scale;
    }
  }

  ControlTask task_;
  double sigma_;
  std::vector<std::vector<double>> belief_;
  std::vector<double> turned_;
  std::map<int, std::vector<int>> distances_;  ///< by goal, on a map
};

const ControlRegistry::Registration sequence_filter_registration({
    "sequence_filter",
    "Bayes filter over the training traversal's places, nothing learned, then the heavier side",
    {{"sigma", "standard deviation of the distance between features of one place", 0.3, 0.01, 10}},
    [](const Parameters& parameters, const ControlTask& task) {
      return std::make_unique<SequenceFilter>(task, parameters["sigma"]);
    },
});

}  // namespace
}  // namespace citylearn
