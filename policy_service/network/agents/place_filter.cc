// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/agents/place_filter.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "policy_service/network/agents/sparse_pass.h"
#include "policy_service/network/agents/street_filter.h"
#include "policy_service/network/belief/motion.h"
#include "policy_service/network/belief/place_keys.h"
#include "policy_service/network/layers/layers.h"
#include "policy_service/network/layers/product.h"

namespace citylearn {
namespace {

using namespace place_filter;

/// A Bayes filter over the route's places (after the histogram filters of Jonschkowski & Brock, 2016, and Karkus, Hsu &
/// Lee, 2018) with a decision head, which the learner's loss trains. It is given as knowledge: the reference frames'
/// features K, the motion of each action, and which actions are masked where.
///
/// The belief p over the N places is uniform at an episode's start, and kept as scores l, p = softmax(l). Each step, t
/// steps into the episode:
///   l moves by the previous action (what falls off is dropped, what enters is excluded; see Motion where actions
///   slip),
///   l_i += s / (1 + h t) (x . K_i), with the K_i most like x where the place was experienced several times, and l_i -=
///   kExclusion for the goal (standing there would have ended the episode) and wherever the actions allowed would be
///   others.
/// What is excluded stays so for the episode, however much else speaks for it. An agent that has reached its goal, and
/// got the next one, is where that goal was: all else is excluded. Evidence counts for less the longer the episode is,
/// because neighbouring frames err alike: h says how much.
///
/// Head: what the belief says seen from the goal. With places weighed by 1 / distance^g (a wrong turn costs most in
/// proportion when the goal is near), and the side that asks for turning about by u (doubt alone is no reason to turn),
/// [2 S(place < goal), 2 S(place > goal)], S being shares of the weighed belief; the belief's mass at distances
/// 1, 2..3, 4..7 ... before the goal and after it (kScales each, the last one open), times 2; its sharpness sum p_i^2;
/// 1 - mask (3), half the previous action one-hot (3)] -> tanh -> tanh -> 3 outputs. A route may as well be walked from
/// its other end: the head looks at these inputs and at their mirror image (before and after, `next` and `previous`
/// exchanged). The first output is the logit of `next`, that of the image the logit of `previous`; the other outputs
/// are logit of `stay` and value, means of both. So nothing it learns can favour one direction. (Without it, four
/// agents of twenty learned to walk one way whatever they saw on 3,559 places, where few goals are reached in
/// training.) The first two inputs also reach the logits of `next` and `previous` directly, times d: an agent that has
/// learned nothing walks to the side where it believes the goal, as QMDP planning would (Littman et al., 1995; within a
/// network: Karkus, Hsu & Lee, 2017), on a route of any length. g, u and d are learned too. s and h are not: rewards
/// ask for a filter that is surer than it may be, and gain nothing by it. The state is l, then t, then 1 + the goal.
///
/// How often actions slip, and agents are kidnapped, is learned unless it is told: the likeliest by where actions led
/// in training, where each step's place is known (add_model_gradient()). No reward has a say in it, so it is an
/// estimate of the world.
template <class S>
class PlaceFilter : public AgentNetwork<S> {
 public:
  PlaceFilter(const Parameters& parameters, const NetworkTask& task)
      : places_(task.frames),
        units_(parameters.integer("units")),
        inputs_(kInputs),
        mirror_(mirrored_inputs(inputs_)),
        sparse_(task.frames >= task.sparse_from),
        keys_(task.reference, task.features, task.frames, sparse_),
        motion_(told_motion<S>(parameters)) {
    log_distances_ = Vector<S>::LinSpaced(places_, S(1), static_cast<S>(places_)).array().log();
    scalars_ = layout_.add("filter.scalars", kScalars, 1);
    if (learns_slip(parameters)) slip_ = layout_.add("filter.slip", 1, 1);
    if (learns_kidnap(parameters)) kidnap_ = layout_.add("filter.kidnap", 1, 1);
    weights1_ = layout_.add("head.1.weight", units_, inputs_);
    bias1_ = layout_.add("head.1.bias", units_, 1);
    weights2_ = layout_.add("head.2.weight", units_, units_);
    bias2_ = layout_.add("head.2.bias", units_, 1);
    weights3_ = layout_.add("head.out.weight", kOutputs, units_);
    bias3_ = layout_.add("head.out.bias", kOutputs, 1);
  }

  static std::vector<ParameterSpec> parameters() {
    std::vector<ParameterSpec> specs = Motion<S>::parameters();
    specs[0].help += "; -1: learned";
    specs[1].help += "; -1: learned where slips are, else 0";
    for (ParameterSpec& spec : specs) spec.default_value = spec.minimum = -1;
    specs.push_back({kSlipsLimitTempering,
                     "evidence is tempered no further than by half the steps between two slips or kidnappings; of "
                     "checkpoints of before 1: by all of them; 0: by those between kidnappings",
                     2, 0, 2, true});
    specs.push_back({"units", "units of each of the head's two layers", 64, 1, 4096, true});
    return specs;
  }

  const std::vector<Tensor>& tensors() const override { return layout_.tensors(); }
  int state_size() const override { return sparse_ ? SparseBelief<S>::kStateSize : places_ + 2; }
  Vector<S> belief(const Eigen::Ref<const Vector<S>>& state) const override {
    if (!sparse_) return state.head(places_);
    SparseBelief<S> belief;
    belief.load(state, places_);
    return belief.scores(places_);
  }
  bool normalises() const override { return true; }
  std::unique_ptr<Workspace<S>> make_workspace() const override { return std::make_unique<Work>(keys_, motion_); }

  void initialise(Random& random, Vector<S>& parameters) const override {
    parameters.setZero(layout_.size());
    auto scalars = layout_.view(parameters, scalars_);
    const auto begin_with = [&](int scalar, double value) {
      scalars(scalar) = static_cast<S>(std::log(value) / kStretch);
    };
    begin_with(kEvidence, 16);
    begin_with(kTempering, 0.15);
    begin_with(kNearness, 0.6);
    begin_with(kTurning, 0.3);
    begin_with(kDirectness, 2);
    const auto first_guess = [&](std::optional<std::size_t> tensor, double p) {
      if (tensor) layout_.view(parameters, *tensor)(0) = static_cast<S>(std::log(p / (1 - p)) / kStretch);
    };
    first_guess(slip_, kFirstSlip);
    first_guess(kidnap_, kFirstKidnap);
    orthogonal<S>(random, std::sqrt(2.0), layout_.view(parameters, weights1_));
    orthogonal<S>(random, std::sqrt(2.0), layout_.view(parameters, weights2_));
    orthogonal<S>(random, 1, layout_.view(parameters, weights3_));
    layout_.view(parameters, weights3_).topRows(kStateValue) *= S(0.01);
  }

  void forward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, const Matrix<S>& state,
               Workspace<S>& workspace) const override {
    Work& work = static_cast<Work&>(workspace);
    const std::ptrdiff_t agents = inputs.agents, columns = agents * inputs.steps;
    const Scalars s = scalars(parameters);
    work.head_input.setZero(inputs_, 2 * columns);
    if (sparse_) {
      const Motion<S> motion = motion_by(parameters);
      work.sparse.set_motion(motion.slip(), motion.kidnap());
      work.sparse.forward(inputs, state, s, work.head_input, work.state);
    } else {
      filter(parameters, inputs, state, s, work);
    }
    for (std::ptrdiff_t column = 0; column < columns; ++column) {
      const std::uint8_t previous = inputs.previous_action[static_cast<std::size_t>(column)];
      for (int action = 0; action < kActions; ++action)
        work.head_input(kMask + action, column) =
            static_cast<S>(!(inputs.allowed[static_cast<std::size_t>(column)] >> action & 1));
      if (previous < kActions) work.head_input(kMask + kActions + previous, column) = S(0.5);
    }

    for (int input = 0; input < inputs_; ++input)
      work.head_input.row(input).tail(columns) =
          work.head_input.row(mirror_[static_cast<std::size_t>(input)]).head(columns);
    set_product(work.layer1, layout_.view(parameters, weights1_), work.head_input);
    work.layer1.colwise() += layout_.view(parameters, bias1_).col(0);
    work.layer1 = work.layer1.array().tanh();
    set_product(work.layer2, layout_.view(parameters, weights2_), work.layer1);
    work.layer2.colwise() += layout_.view(parameters, bias2_).col(0);
    work.layer2 = work.layer2.array().tanh();
    set_product(work.both, layout_.view(parameters, weights3_), work.layer2);
    work.both.colwise() += layout_.view(parameters, bias3_).col(0);
    const auto seen = work.both.leftCols(columns), image = work.both.rightCols(columns);
    work.heads.logits.resize(kActions, columns);
    work.heads.logits.row(kStay) = S(0.5) * (seen.row(kStaying) + image.row(kStaying));
    work.heads.logits.row(kNext) = seen.row(kWayOn);
    work.heads.logits.row(kPrevious) = image.row(kWayOn);
    for (const Way& way : kWays)
      work.heads.logits.row(way.action) += s.directness * work.head_input.row(way.input).head(columns);
    work.heads.values = S(0.5) * (seen.row(kStateValue) + image.row(kStateValue));
    mask_logits(inputs.allowed, work.heads.logits);
  }

  void backward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Workspace<S>& workspace,
                const Heads<S>& derivative, Vector<S>& gradient) const override {
    Work& work = static_cast<Work&>(workspace);
    const std::ptrdiff_t agents = inputs.agents, columns = agents * inputs.steps;
    work.both.resize(kOutputs, 2 * columns);
    auto seen = work.both.leftCols(columns), image = work.both.rightCols(columns);
    seen.row(kStaying) = image.row(kStaying) = S(0.5) * derivative.logits.row(kStay);
    seen.row(kWayOn) = derivative.logits.row(kNext);
    image.row(kWayOn) = derivative.logits.row(kPrevious);
    seen.row(kStateValue) = image.row(kStateValue) = S(0.5) * derivative.values;
    add_product(layout_.view(gradient, weights3_), work.both, work.layer2.transpose());
    layout_.view(gradient, bias3_) += work.both.rowwise().sum();
    set_product(work.layer_gradient, layout_.view(parameters, weights3_).transpose(), work.both);
    work.layer_gradient.array() *= S(1) - work.layer2.array().square();
    add_product(layout_.view(gradient, weights2_), work.layer_gradient, work.layer1.transpose());
    layout_.view(gradient, bias2_) += work.layer_gradient.rowwise().sum();
    set_product(work.layer2, layout_.view(parameters, weights2_).transpose(), work.layer_gradient);
    work.layer_gradient = work.layer2.array() * (S(1) - work.layer1.array().square());
    add_product(layout_.view(gradient, weights1_), work.layer_gradient, work.head_input.transpose());
    layout_.view(gradient, bias1_) += work.layer_gradient.rowwise().sum();
    set_product(work.input_gradient, layout_.view(parameters, weights1_).transpose(), work.layer_gradient);
    for (int input = 0; input < inputs_; ++input)
      work.input_gradient.row(input).head(columns) +=
          work.input_gradient.row(mirror_[static_cast<std::size_t>(input)]).tail(columns);

    const Scalars s = scalars(parameters);
    Scalars ds{};
    for (const Way& way : kWays) {
      const auto by_logit = derivative.logits.row(way.action);
      ds.directness += by_logit.dot(work.head_input.row(way.input).head(columns));
      work.input_gradient.row(way.input).head(columns) += s.directness * by_logit;
    }
    if (sparse_) work.sparse.backward(inputs, s, work.input_gradient, ds);
    for (std::ptrdiff_t column = sparse_ ? columns : 0; column < columns; ++column) {
      const std::size_t index = static_cast<std::size_t>(column);
      const std::ptrdiff_t goal = inputs.goal[index], rest = places_ - goal - 1;
      const std::uint8_t previous = inputs.previous_action[index];
      const auto belief = work.belief.col(column);
      const Turning weight = s.turnings(previous);
      const WeighedSides sides(belief, work.weights, goal, weight);
      const S before = S(2) * work.input_gradient(0, column), after = S(2) * work.input_gradient(1, column);
      const S mean = (before * sides.before + after * sides.after) / sides.all();
      const S by_before = (before - mean) / sides.all(), by_after = (after - mean) / sides.all();
      const auto by_side = [&](const auto& of, const auto& weights, const auto& log_distances, S by) {
        ds.nearness -= by * of.dot(weights.cwiseProduct(log_distances));
      };
      by_side(belief.head(goal), work.weights.head(goal).reverse(), log_distances_.head(goal).reverse(),
              by_before * weight.before);
      by_side(belief.tail(rest), work.weights.head(rest), log_distances_.head(rest), by_after * weight.after);
      if (previous == kPrevious) ds.turning += by_before * sides.before / s.turning;
      if (previous == kNext) ds.turning += by_after * sides.after / s.turning;
    }
    auto out = layout_.view(gradient, scalars_);
    const auto learn = [&](int scalar, S value, S by) { out(scalar) += static_cast<S>(kStretch) * value * by; };
    learn(kNearness, s.nearness, ds.nearness);
    learn(kTurning, s.turning, ds.turning);
    learn(kDirectness, s.directness, ds.directness);
  }

  void add_model_gradient(const Vector<S>& parameters, const NetworkInputs<S>& inputs,
                          Vector<S>& gradient) const override {
    const auto at = [&](std::optional<std::size_t> tensor) {
      return tensor ? layout_.view(gradient, *tensor).data() : nullptr;
    };
    place_filter::add_model_gradient(StateMap(inputs.frames), motion_by(parameters), inputs, at(slip_), at(kidnap_));
  }

 private:
  struct Way {
    int input;  ///< of the head: how likely it is that `action` leads nearer to the goal
    std::uint8_t action;
  };
  static constexpr Way kWays[] = {{0, kNext}, {1, kPrevious}};
  using Scalars = place_filter::Scalars<S>;
  using Turning = place_filter::Sides<S>;  // weights of the sides
  /// The weighed belief before and after the goal.
  struct WeighedSides {
    template <class Belief>
    WeighedSides(const Belief& belief, const Vector<S>& weights, std::ptrdiff_t goal, const Turning& turning)
        : before(turning.before * belief.head(goal).dot(weights.head(goal).reverse())),
          after(turning.after * belief.tail(belief.size() - goal - 1).dot(weights.head(belief.size() - goal - 1))) {}
    S all() const { return before + after + std::numeric_limits<S>::min(); }
    S before, after;
  };
  struct Work : Workspace<S> {
    Work(const PlaceKeys<S>& keys, const Motion<S>& how) : motion(how), sparse(keys, how) {}
    Motion<S> motion;                          // with room for its sums
    Matrix<S> similarities, similarity;        // EN x U; N x U
    Matrix<S> score, belief;                   // N x TB
    Vector<S> step;                            // TB, of the episode
    Vector<S> weights;                         // N, of places at distances from 1 on to the goal
    Matrix<S> head_input, input_gradient;      // inputs x 2 TB: as they are, then mirrored
    Matrix<S> layer1, layer2, layer_gradient;  // units x 2 TB
    Matrix<S> both;                            // outputs x 2 TB
    SparsePass<S> sparse;
  };

  /// Moves all scores and sees; sets the inputs of the head that come from the belief.
  void filter(const Vector<S>& parameters, const NetworkInputs<S>& inputs, const Matrix<S>& state, const Scalars& s,
              Work& work) const {
    const std::ptrdiff_t agents = inputs.agents, columns = agents * inputs.steps;
    for (Matrix<S>* part : {&work.score, &work.belief}) part->resize(places_, columns);
    const Motion<S> motion = motion_by(parameters);
    work.motion.set(motion.slip(), motion.kidnap());
    const bool exact = work.motion.exact();
    work.step.resize(columns);
    work.weights = (-s.nearness * log_distances_).array().exp();

    keys_.compare(inputs.features.leftCols(inputs.distinct), places_, work.similarities, work.similarity);
    for (std::ptrdiff_t column = 0; column < columns; ++column) {
      const std::size_t index = static_cast<std::size_t>(column);
      const std::uint8_t previous = inputs.previous_action[index];
      auto score = work.score.col(column);
      const bool begins = inputs.first[index], carried = column < agents;  // carried: from the state
      const int before = begins    ? -1
                         : carried ? goal_in(state(places_ + 1, column))
                                   : inputs.goal[static_cast<std::size_t>(column - agents)];
      work.step(column) = begins ? S(0) : motion.later(carried ? state(places_, column) : work.step(column - agents));
      if (begins) {
        score.setConstant(kNever);
        score.head(inputs.frames).setZero();
      } else if (before >= 0 && before != inputs.goal[index]) {
        score.setConstant(kNever);
        score.head(inputs.frames).setConstant(-kExclusion);
        score(before) = 0;
      } else if (carried) {
        work.motion.move_scores(previous, state.col(column).head(places_), score, kNever);
      } else if (exact) {
        work.motion.shift(previous, work.score.col(column - agents), score, kNever);
      } else {
        work.motion.move_belief(previous, work.belief.col(column - agents), score, kNever);
      }
      score += s.evidence / (1 + s.tempering * work.step(column)) * work.similarity.col(inputs.seen[index]);
      exclude(inputs.goal[index], inputs.frames, inputs.allowed[index], S(kExclusion), score);
      auto belief = work.belief.col(column);
      belief = (score.array() - score.maxCoeff()).exp();
      belief /= belief.sum();

      const std::ptrdiff_t goal = inputs.goal[index];
      work.head_input(kSharpness, column) = belief.squaredNorm();
      const WeighedSides sides(belief, work.weights, goal, s.turnings(previous));
      work.head_input(0, column) = S(2) * sides.before / sides.all();
      work.head_input(1, column) = S(2) * sides.after / sides.all();
      for_each_scale(goal, [&](int input, std::ptrdiff_t first, std::ptrdiff_t count) {
        work.head_input(input, column) = S(2) * belief.segment(first, count).sum();
      });
    }
    work.state.resize(places_ + 2, agents);
    work.state.topRows(places_) = work.score.rightCols(agents);
    work.state.row(places_) = work.step.tail(agents).transpose();
    for (std::ptrdiff_t agent = 0; agent < agents; ++agent)
      work.state(places_ + 1, agent) =
          static_cast<S>(inputs.goal[static_cast<std::size_t>(columns - agents + agent)] + 1);
  }
  /// Returns the goal of a state; -1: there was none.
  int goal_in(S stored) const { return stored > 0 ? static_cast<int>(std::min(stored, S(places_))) - 1 : -1; }
  Motion<S> motion_by(const Vector<S>& parameters) const {
    const auto value = [&](std::optional<std::size_t> tensor, S told) {
      return tensor ? learned_probability(layout_.view(parameters, *tensor)(0)) : told;
    };
    return {value(slip_, motion_.slip()), std::max(value(kidnap_, 0), motion_.kidnap()), motion_.limit()};
  }
  Scalars scalars(const Vector<S>& parameters) const {
    const auto stored = layout_.view(parameters, scalars_);
    const auto value = [&](int scalar) { return std::exp(static_cast<S>(kStretch) * stored(scalar)); };
    return {value(kEvidence), value(kTempering), value(kNearness), value(kTurning), value(kDirectness)};
  }

  /// Calls use(input, first, count) with the places of each input that is a mass by distance.
  template <class Use>
  void for_each_scale(std::ptrdiff_t goal, Use&& use) const {
    for (int scale = 0; scale < kScales; ++scale) {
      const std::ptrdiff_t near = std::ptrdiff_t{1} << scale;
      const std::ptrdiff_t far = scale + 1 < kScales ? 2 * near - 1 : places_;
      const std::ptrdiff_t first = std::max<std::ptrdiff_t>(0, goal - far);
      if (goal >= near) use(2 + scale, first, goal - near - first + 1);
      const std::ptrdiff_t last = std::min<std::ptrdiff_t>(places_ - 1, goal + far);
      if (goal + near < places_) use(2 + kScales + scale, goal + near, last - goal - near + 1);
    }
  }

  int places_, units_, inputs_;
  std::vector<int> mirror_;
  bool sparse_;  ///< beliefs are
  PlaceKeys<S> keys_;
  Vector<S> log_distances_;  ///< N, of places at distances from 1 on to the goal
  Motion<S> motion_;
  TensorLayout layout_;
  std::optional<std::size_t> slip_, kidnap_;  ///< tensors of what is learned
  std::size_t scalars_, weights1_, bias1_, weights2_, bias2_, weights3_, bias3_;
};

const NetworkRegistry<NetworkScalar>::Registration place_filter_registration({
    "place_filter",
    "a Bayes filter over the training route's places with a decision head",
    PlaceFilter<NetworkScalar>::parameters(),
    [](const Parameters& parameters, const NetworkTask& task) {
      if (task.goals > 0 && !task.streets)
        throw Error("walks by the map of its streets, which a checkpoint has not", "network place_filter",
                    "load the checkpoint in Python, or evaluate it with policy_service; features can be exported");
      return task.streets ? make_street_filter<NetworkScalar>(parameters, task)
                          : std::make_unique<PlaceFilter<NetworkScalar>>(parameters, task);
    },
    {{"agents", 32},
     {"segment", 64},
     {"sequence", 16},
     {"steps", 160000},
     {"noise-frame", 0},
     {"noise-place", 1},
     {"streets.noise-place", 3},  // a view is told from more others, and at 1 nothing is left to learn
     {"noise-episode", 1},
     {"minibatch", 16},
     {"epochs", 2},
     {"relabel.epochs", 8},
     {"step-cost", 0.05},
     {"relabel.steps", 40000},
     {"relabel.adam-epsilon", 1e-2},  // once all is learned gradients are tiny, and Adam enlarges the first that is not
     {"vtrace.learning-rate", 3e-3},
     {"learning-rate", 6e-3},
     {"gamma", 0.9},
     {"lambda", 0.8},
     {"value-clip", 0.2},
     {"entropy", 0.02},
     {"entropy-until", 1}},
});

}  // namespace
}  // namespace citylearn
