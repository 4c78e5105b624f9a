#include <algorithm>
#include <cmath>

#include "policy_service/control.h"

namespace citylearn {
namespace {

/// A Bayes filter over the places of the route, without anything learned: uniform at first, moved by the known action,
/// weighed by exp(-|x - x_ref|^2 / (2 sigma^2)) for each place's reference features, and zero at the goal while the
/// episode lasts. Walks to the heavier side of the goal.
class SequenceFilter : public Policy {
 public:
  SequenceFilter(const ControlTask& task, double sigma) : task_(task), sigma_(sigma) {
    if (task.reference.empty())
      throw Error("needs the features of the training traversal", "sequence_filter",
                  "start an env_service on a traversal that has features");
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
      }
      weigh(belief, observation.features().data() + i * task_.dimension);
      belief[goal] = kNever;
      const double top = *std::max_element(belief.begin(), belief.end());
      double before = 0, behind = 0;
      for (int place = 0; place < task_.frames; ++place) {
        belief[place] = std::max(belief[place] - top, kNever);
        (place < goal ? before : behind) += std::exp(belief[place]);
      }
      choice[i] = allowed_or_turn(before > behind ? kNext : kPrevious, observation.allowed()[i]);
    }
  }

 private:
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
};

const ControlRegistry::Registration registration({
    "sequence_filter",
    "Bayes filter over the training traversal's places, nothing learned, then the heavier side",
    {{"sigma", "standard deviation of the distance between features of one place", 0.3, 0.01, 10}},
    [](const Parameters& parameters, const ControlTask& task) {
      return std::make_unique<SequenceFilter>(task, parameters["sigma"]);
    },
});

}  // namespace
}  // namespace citylearn
