// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "core/task/route_map.h"
#include "policy_service/network/layers.h"

namespace citylearn {
namespace {

/// A differentiable Bayes filter over the route's places with a decision head, both trained by the learner's loss
/// (after the histogram filters of Jonschkowski & Brock, 2016, and Karkus, Hsu & Lee, 2018). It is given as knowledge:
/// the reference frames' features K, the motion of each action, and which actions are masked where.
///
/// Belief p over the N places, uniform at an episode's start. Each step:
///   q = p moved by the previous action (what falls off is dropped), q' = (1 - k) q + k / N,
///   e_i = s_f (x . K_i) - s_m |mask - mask of place i|_1 - s_g [i = goal]   (standing at the goal would have ended
///   it), p = softmax(c log q' + e).
/// Head: [2 P(place < goal), 2 P(place > goal), 1 - mask (3), half the previous action one-hot (3)] -> tanh -> tanh ->
/// policy (3) and value (1).
///
/// On a map (task.turns) the action `stay` moves the belief along the turns, and the head's first two inputs are what
/// they are on a line in other words: 2 P(next leads nearer to the goal), 2 P(previous does); 2 P(turning does) comes
/// last. All places are in use then.
template <class S>
class PlaceFilter : public AgentNetwork<S> {
 public:
  PlaceFilter(const Parameters& parameters, const NetworkTask& task)
      : places_(task.frames),
        units_(parameters.integer("units")),
        inputs_(kInputs + (task.turns.empty() ? 0 : 1)),
        keys_(task.reference.template cast<S>().transpose()),
        turns_(task.turns) {
    if (task.features < 1 || task.reference.rows() != task.features || task.reference.cols() != task.frames)
      throw Error("needs the features of all " + std::to_string(task.frames) + " frames of the training route",
                  "reference", "train where the env_service has features, or give it an encoder_service");
    check_turns(turns_, places_);
    if (!turns_.empty()) find_ways();
    scalars_ = layout_.add("filter.scalars", kScalars, 1);
    weights1_ = layout_.add("head.1.weight", units_, inputs_);
    bias1_ = layout_.add("head.1.bias", units_, 1);
    weights2_ = layout_.add("head.2.weight", units_, units_);
    bias2_ = layout_.add("head.2.bias", units_, 1);
    weights3_ = layout_.add("head.out.weight", kActions + 1, units_);
    bias3_ = layout_.add("head.out.bias", kActions + 1, 1);
  }

  static std::vector<ParameterSpec> parameters() {
    return {{"units", "units of each of the head's two layers", 64, 1, 4096, true}};
  }

  const std::vector<Tensor>& tensors() const override { return layout_.tensors(); }
  int state_size() const override { return places_; }
  std::unique_ptr<Workspace<S>> make_workspace() const override { return std::make_unique<Work>(); }

  void initialise(Random& random, Vector<S>& parameters) const override {
    parameters.setZero(layout_.size());
    auto scalars = layout_.view(parameters, scalars_);
    scalars(kFeatureScale) = static_cast<S>(std::log(11.0) / kStretch);
    scalars(kMaskScale) = static_cast<S>(std::log(4.0) / kStretch);
    scalars(kGoalScale) = static_cast<S>(std::log(4.0) / kStretch);
    scalars(kPersistence) = static_cast<S>(3.0 / kStretch);
    // Actions do what they say, so that a belief need not be given up for a stretch that looks like another one.
    scalars(kFloor) = static_cast<S>(std::log(1e-5) / kStretch);
    orthogonal<S>(random, std::sqrt(2.0), layout_.view(parameters, weights1_));
    orthogonal<S>(random, std::sqrt(2.0), layout_.view(parameters, weights2_));
    orthogonal<S>(random, 1, layout_.view(parameters, weights3_));
    layout_.view(parameters, weights3_).topRows(kActions) *= S(0.01);
  }

  void forward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, const Matrix<S>& state,
               Workspace<S>& workspace) const override {
    Work& work = static_cast<Work&>(workspace);
    const std::ptrdiff_t agents = inputs.agents, columns = agents * inputs.steps;
    for (Matrix<S>* part : {&work.moved, &work.log_prior, &work.belief}) part->resize(places_, columns);
    work.head_input.setZero(inputs_, columns);
    const Scalars s = scalars(parameters);

    work.similarity.noalias() = keys_ * inputs.features.leftCols(inputs.distinct);
    for (std::ptrdiff_t column = 0; column < columns; ++column) {
      const std::size_t index = static_cast<std::size_t>(column);
      auto moved = work.moved.col(column);
      const std::uint8_t previous = inputs.previous_action[index];
      if (inputs.first[index]) {
        moved.setZero();
        moved.head(inputs.frames).setConstant(S(1) / static_cast<S>(inputs.frames));
      } else if (column < agents) {
        shift(previous, state.col(column), moved);
      } else {
        shift(previous, work.belief.col(column - agents), moved);
      }
      auto log_prior = work.log_prior.col(column);
      log_prior = ((S(1) - s.floor) * moved.array() + s.floor / static_cast<S>(places_)).log();
      auto belief = work.belief.col(column);
      const std::uint8_t allowed = inputs.allowed[index];
      belief = s.persistence * log_prior + s.features * work.similarity.col(inputs.seen[index]);
      belief.array() -= s.mask * static_cast<S>(mask_distance(allowed, kInside));
      belief(0) += s.mask * static_cast<S>(mask_distance(allowed, kInside) - mask_distance(allowed, kFirstPlace));
      belief(inputs.frames - 1) +=
          s.mask * static_cast<S>(mask_distance(allowed, kInside) - mask_distance(allowed, kLastPlace));
      belief(inputs.goal[index]) -= s.goal;
      belief = (belief.array() - belief.maxCoeff()).exp();
      belief /= belief.sum();

      const std::ptrdiff_t goal = inputs.goal[index];
      if (turns_.empty()) {
        work.head_input(0, column) = S(2) * belief.head(goal).sum();
        work.head_input(1, column) = S(2) * belief.tail(places_ - goal - 1).sum();
      } else {
        for (const auto& [input, way] : kWays)
          for (std::ptrdiff_t place = 0; place < places_; ++place)
            if (ways(goal)[place] & way) work.head_input(input, column) += S(2) * belief(place);
      }
      for (int action = 0; action < kActions; ++action)
        work.head_input(2 + action, column) = static_cast<S>(!(allowed >> action & 1));
      if (previous < kActions) work.head_input(2 + kActions + previous, column) = S(0.5);
    }
    work.state = work.belief.rightCols(agents);

    work.layer1.noalias() = layout_.view(parameters, weights1_) * work.head_input;
    work.layer1.colwise() += layout_.view(parameters, bias1_).col(0);
    work.layer1 = work.layer1.array().tanh();
    work.layer2.noalias() = layout_.view(parameters, weights2_) * work.layer1;
    work.layer2.colwise() += layout_.view(parameters, bias2_).col(0);
    work.layer2 = work.layer2.array().tanh();
    work.both.noalias() = layout_.view(parameters, weights3_) * work.layer2;
    work.both.colwise() += layout_.view(parameters, bias3_).col(0);
    work.heads.logits = work.both.topRows(kActions);
    work.heads.values = work.both.bottomRows(1);
    mask_logits(inputs.allowed, work.heads.logits);
  }

  void backward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Workspace<S>& workspace,
                const Heads<S>& derivative, Vector<S>& gradient) const override {
    Work& work = static_cast<Work&>(workspace);
    const std::ptrdiff_t agents = inputs.agents, columns = agents * inputs.steps;
    work.both.topRows(kActions) = derivative.logits;
    work.both.bottomRows(1) = derivative.values;
    layout_.view(gradient, weights3_).noalias() += work.both * work.layer2.transpose();
    layout_.view(gradient, bias3_) += work.both.rowwise().sum();
    work.layer_gradient.noalias() = layout_.view(parameters, weights3_).transpose() * work.both;
    work.layer_gradient.array() *= S(1) - work.layer2.array().square();
    layout_.view(gradient, weights2_).noalias() += work.layer_gradient * work.layer1.transpose();
    layout_.view(gradient, bias2_) += work.layer_gradient.rowwise().sum();
    work.layer2.noalias() = layout_.view(parameters, weights2_).transpose() * work.layer_gradient;
    work.layer_gradient = work.layer2.array() * (S(1) - work.layer1.array().square());
    layout_.view(gradient, weights1_).noalias() += work.layer_gradient * work.head_input.transpose();
    layout_.view(gradient, bias1_) += work.layer_gradient.rowwise().sum();
    work.input_gradient.noalias() = layout_.view(parameters, weights1_).transpose() * work.layer_gradient;

    const Scalars s = scalars(parameters);
    Scalars ds{};
    work.belief_gradient.setZero(places_, columns);
    Vector<S>& by_energy = work.column;  // derivative by c log q' + e
    for (std::ptrdiff_t column = columns - 1; column >= 0; --column) {
      const std::size_t index = static_cast<std::size_t>(column);
      const std::ptrdiff_t goal = inputs.goal[index];
      const auto belief = work.belief.col(column);
      auto by_belief = work.belief_gradient.col(column);
      if (turns_.empty()) {
        by_belief.head(goal).array() += S(2) * work.input_gradient(0, column);
        by_belief.tail(places_ - goal - 1).array() += S(2) * work.input_gradient(1, column);
      } else {
        for (const auto& [input, way] : kWays)
          for (std::ptrdiff_t place = 0; place < places_; ++place)
            if (ways(goal)[place] & way) by_belief(place) += S(2) * work.input_gradient(input, column);
      }
      by_energy = belief.array() * (by_belief.array() - by_belief.dot(belief));

      const std::uint8_t allowed = inputs.allowed[index];
      const std::ptrdiff_t last = inputs.frames - 1;
      ds.features += by_energy.dot(work.similarity.col(inputs.seen[index]));
      ds.goal -= by_energy(goal);
      ds.mask -= static_cast<S>(mask_distance(allowed, kInside)) * by_energy.sum() +
                 static_cast<S>(mask_distance(allowed, kFirstPlace) - mask_distance(allowed, kInside)) * by_energy(0) +
                 static_cast<S>(mask_distance(allowed, kLastPlace) - mask_distance(allowed, kInside)) * by_energy(last);
      const auto log_prior = work.log_prior.col(column);
      ds.persistence += by_energy.dot(log_prior);
      by_energy = s.persistence * by_energy.array() * (-log_prior.array()).exp();  // now by the floored prior q'
      const auto moved = work.moved.col(column);
      ds.floor += by_energy.sum() / static_cast<S>(places_) - by_energy.dot(moved);
      if (column < agents || inputs.first[index]) continue;
      by_energy *= S(1) - s.floor;
      unshift(inputs.previous_action[index], by_energy, work.belief_gradient.col(column - agents));
    }
    auto out = layout_.view(gradient, scalars_);
    const S stretch = static_cast<S>(kStretch);
    out(kFeatureScale) += stretch * s.features * ds.features;
    out(kMaskScale) += stretch * s.mask * ds.mask;
    out(kGoalScale) += stretch * s.goal * ds.goal;
    out(kPersistence) += stretch * s.persistence * (S(1) - s.persistence) * ds.persistence;
    out(kFloor) += stretch * s.floor * (S(1) - s.floor) * ds.floor;
  }

 private:
  enum { kFeatureScale, kMaskScale, kPersistence, kFloor, kGoalScale, kScalars };
  enum { kInputs = 2 + 2 * kActions };  ///< of the head, on a line
  enum : std::uint8_t { kByNext = 1, kByPrevious = 2, kByTurning = 4 };
  struct Way {
    int input;
    std::uint8_t way;
  };
  static constexpr Way kWays[] = {{0, kByNext}, {1, kByPrevious}, {kInputs, kByTurning}};
  static constexpr std::uint8_t kInside = 0b111, kFirstPlace = 0b011, kLastPlace = 0b101;  ///< actions allowed there

  struct Scalars {
    S features, mask, persistence, floor, goal;
  };
  struct Work : Workspace<S> {
    Matrix<S> similarity;                      // N x U
    Matrix<S> moved, log_prior, belief;        // N x TB
    Matrix<S> belief_gradient;                 // N x TB
    Matrix<S> head_input, input_gradient;      // inputs x TB
    Matrix<S> layer1, layer2, layer_gradient;  // units x TB
    Matrix<S> both;                            // 4 x TB: logits and value
    Vector<S> column;                          // N
  };

  Scalars scalars(const Vector<S>& parameters) const {
    const auto stored = layout_.view(parameters, scalars_);
    const auto logistic = [](S x) { return S(1) / (S(1) + std::exp(-x)); };
    const S stretch = static_cast<S>(kStretch);
    return {std::exp(stretch * stored(kFeatureScale)), std::exp(stretch * stored(kMaskScale)),
            logistic(stretch * stored(kPersistence)), logistic(stretch * stored(kFloor)),
            std::exp(stretch * stored(kGoalScale))};
  }

  static int mask_distance(std::uint8_t one, std::uint8_t other) {
    const unsigned differing = (one ^ other) & 0b111u;
    return static_cast<int>((differing & 1) + (differing >> 1 & 1) + (differing >> 2 & 1));
  }

  /// Which steps lead nearer to each goal from each place.
  void find_ways() {
    const auto places = static_cast<std::size_t>(places_);
    ways_.assign(places * places, 0);
    std::vector<int> distances;
    for (int goal = 0; goal < places_; ++goal) {
      distances_to(goal, places_, turns_, distances);
      const auto nearer = [&](int from, int to) {
        return to >= 0 && to < places_ &&
               distances[static_cast<std::size_t>(to)] < distances[static_cast<std::size_t>(from)];
      };
      std::uint8_t* way = ways_.data() + static_cast<std::size_t>(goal) * places;
      for (int place = 0; place < places_; ++place, ++way) {
        if (nearer(place, place_after(place, kNext, turns_))) *way |= kByNext;
        if (nearer(place, place_after(place, kPrevious, turns_))) *way |= kByPrevious;
        if (nearer(place, place_after(place, kStay, turns_))) *way |= kByTurning;
      }
    }
  }
  const std::uint8_t* ways(std::ptrdiff_t goal) const {
    return ways_.data() + static_cast<std::size_t>(goal) * static_cast<std::size_t>(places_);
  }

  template <class From, class To>
  void shift(std::uint8_t action, const From& from, To&& to) const {
    const std::ptrdiff_t n = places_ - 1;
    if (action == kNext) {
      to.tail(n) = from.head(n);
      to(0) = 0;
    } else if (action == kPrevious) {
      to.head(n) = from.tail(n);
      to(n) = 0;
    } else if (turns_.empty()) {
      to = from;
    } else {
      for (std::ptrdiff_t place = 0; place <= n; ++place) to(turns_[static_cast<std::size_t>(place)]) = from(place);
    }
  }
  template <class From, class To>
  void unshift(std::uint8_t action, const From& from, To&& to) const {
    const std::ptrdiff_t n = places_ - 1;
    if (action == kNext) {
      to.head(n) += from.tail(n);
    } else if (action == kPrevious) {
      to.tail(n) += from.head(n);
    } else if (turns_.empty()) {
      to += from;
    } else {
      for (std::ptrdiff_t place = 0; place <= n; ++place) to(place) += from(turns_[static_cast<std::size_t>(place)]);
    }
  }

  int places_, units_, inputs_;
  Matrix<S> keys_;                  ///< N x D
  std::vector<int> turns_;          ///< N; empty on a line
  std::vector<std::uint8_t> ways_;  ///< N x N on a map, goal-major: which steps lead nearer
  TensorLayout layout_;
  std::size_t scalars_, weights1_, bias1_, weights2_, bias2_, weights3_, bias3_;
};

const NetworkRegistration<PlaceFilter> place_filter_registration{
    "place_filter",
    "a differentiable Bayes filter over the training route's places with a decision head",
    PlaceFilter<NetworkScalar>::parameters(),
    {{"agents", 8},
     {"segment", 64},
     {"sequence", 64},
     {"steps", 160000},
     {"noise-frame", 0},
     {"noise-place", 1},
     {"noise-episode", 1},
     {"minibatch", 4},
     {"epochs", 3},
     {"relabel.epochs", 8},
     {"relabel.steps", 40000},
     {"vtrace.learning-rate", 3e-3},
     {"learning-rate", 6e-3},
     {"gamma", 0.9},
     {"lambda", 0.8},
     {"value-clip", 0.2},
     {"entropy", 0.02},
     {"entropy-until", 1}}};

}  // namespace
}  // namespace citylearn
