// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/agents/street_filter.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "policy_service/network/agents/place_filter.h"
#include "policy_service/network/autodiff/autodiff_network.h"
#include "policy_service/network/belief/sparse_filter.h"
#include "policy_service/network/belief/street_votes.h"

namespace citylearn {
namespace {

using namespace place_filter;

/// place_filter on streets: a Bayes filter over the states of a map (SparseFilter), and a decision head that learns.
/// The filter has no part that rewards change, as on a line: what is seen weighs s / (1 + h t), s = 16, h = 0.2, and a
/// view counts once in an episode. (An agent that turns round sees two views again and again. Counted each time, they
/// nail it to the wrong place where they look more like that one.)
///
/// Head: for each action the belief in states where it leads nearer to the goal, times 3; sharpness sum p^2; the
/// likeliest state's belief; whether the view is new; 1 - mask (3); half the previous action one-hot (3) -> tanh ->
/// tanh -> 3 outputs. Left and right are alike: the head looks at these inputs and at their mirror image (left and
/// right exchanged). The first output is the logit of `left`, that of the image the logit of `right`; the others are
/// logit of `forward` and value, means of both. The first three inputs also reach the logits directly, times d, which
/// is learned: an agent that has learned nothing does what most of its belief asks for. No tensor depends on the map,
/// so that what is learned on one walks on any other.
///
/// Turns are masked where TurnGuard says so: here and not where actions are chosen, so that a learner knows it.
///
/// The state is the belief's, then the number of turns in a row, the number of views seen, and the last of these.
template <class S>
class StreetFilter : public AutodiffNetwork<S> {
  using Base = AutodiffNetwork<S>;

 public:
  StreetFilter(const Parameters& parameters, const NetworkTask& task)
      : map_(task.streets),
        goal_radius_(task.goal_radius),
        guard_(*map_),
        keys_(task.reference, task.features, task.frames, /*compact=*/true),
        motion_(told_motion<S>(parameters)) {
    const auto scalar = [&](const char* name, double begin) { return this->bias(name, 1, begin / kStretch); };
    directness_ = scalar("filter.directness", std::log(2.0));
    if (learns_slip(parameters)) slip_ = scalar("filter.slip", log_odds(kFirstSlip));
    if (learns_kidnap(parameters)) kidnap_ = scalar("filter.kidnap", log_odds(kFirstKidnap));
    const int units = parameters.integer("units");
    const auto layer = [&](const std::string& name, int rows, int cols, double gain) {
      return Layer{this->weights("head." + name + ".weight", rows, cols, gain),
                   this->bias("head." + name + ".bias", rows)};
    };
    first_ = layer("1", units, kInputs, std::sqrt(2.0));
    second_ = layer("2", units, units, std::sqrt(2.0));
    policy_ = layer("policy", 2, units, 0.01);
    value_ = layer("value", 1, units, 1);
  }

  int state_size() const override { return kState; }
  Vector<S> belief(const Eigen::Ref<const Vector<S>>& state) const override {
    SparseBelief<S> belief;
    belief.load(state.head(SparseBelief<S>::kStateSize), map_->states());
    return belief.scores(map_->states());
  }
  bool normalises() const override { return true; }
  std::unique_ptr<Workspace<S>> make_workspace() const override { return std::make_unique<Work>(*this); }

  void add_model_gradient(const Vector<S>& parameters, const NetworkInputs<S>& inputs,
                          Vector<S>& gradient) const override {
    const auto at = [&](std::optional<std::size_t> tensor, auto& flat) {
      return tensor ? flat.data() + this->tensors()[*tensor].offset : nullptr;
    };
    if (slip_)
      place_filter::add_model_gradient(*map_, motion_by(at(slip_, parameters), at(kidnap_, parameters)), inputs,
                                       at(slip_, gradient), at(kidnap_, gradient));
  }

 protected:
  ForwardResult<S> run(const ForwardPass<S>& pass) const override {
    Work& work = static_cast<Work&>(pass.workspace);
    filter(pass, work);
    const std::ptrdiff_t count = work.seen.cols();
    const Variable<S> votes = pass.tape.constant(work.seen.topRows(kActions));
    Matrix<S> both(kInputs, 2 * count);
    both << work.seen, work.seen(mirror(), Eigen::all);
    const auto layer = [&](const Layer& of, const Variable<S>& x) {
      return pass.tensors[of.weights] * x + pass.tensors[of.bias];
    };
    const Variable<S> hidden = tanh(layer(second_, tanh(layer(first_, pass.tape.constant(both)))));
    const Variable<S> policy = layer(policy_, hidden), value = layer(value_, hidden);
    const auto seen = [&](const Variable<S>& of, int row) { return columns(rows(of, row, 1), 0, count); };
    const auto image = [&](const Variable<S>& of, int row) { return columns(rows(of, row, 1), count, count); };
    const auto mean = [&](const Variable<S>& of, int row) { return S(0.5) * (seen(of, row) + image(of, row)); };
    const Variable<S> directness = map_elements(
        pass.tensors[directness_], [](const auto& x) { return (S(kStretch) * x).exp(); },
        [](const auto& y) { return S(kStretch) * y; });
    const auto with_vote = [&](const Variable<S>& logit, int action) {
      return logit + directness * rows(votes, action, 1);
    };
    return {stack_rows<S>({with_vote(seen(policy, 0), kLeft), with_vote(mean(policy, 1), kForward),
                           with_vote(image(policy, 0), kRight)}) +
                pass.tape.constant(work.guard),
            mean(value, 0), pass.tape.constant(work.after)};
  }

 private:
  enum {
    kSharpness = kActions,
    kLargest,
    kNew,
    kMask,
    kPreviousAction = kMask + kActions,
    kInputs = kPreviousAction + kActions
  };
  enum { kTurns = SparseBelief<S>::kStateSize, kViews, kFirstView };
  static constexpr int kRemembered = 64, kState = kFirstView + kRemembered;  // views
  static constexpr S kEvidence = 16, kTempering = S(0.2);

  struct Layer {
    std::size_t weights = 0, bias = 0;
  };
  /// What an agent carries from step to step.
  struct Walker {
    SparseBelief<S> belief;
    int turns = 0;
    std::size_t count = 0;   // of views seen
    std::vector<int> views;  // the last of these, a ring
  };
  struct Work : Base::Work {
    explicit Work(const StreetFilter& of)
        : filter(of.keys_, of.motion_, of.map_, of.goal_radius_), fields(*of.map_, of.goal_radius_) {}
    SparseFilter<S> filter;
    DistanceFields fields;
    std::vector<Walker> walkers;       // B
    std::vector<SparseStep<S>> steps;  // B
    Matrix<S> seen, guard, after;      // inputs x TB; 3 x TB; state x B
  };

  static double log_odds(double p) { return std::log(p / (1 - p)); }
  static std::vector<int> mirror() {
    std::vector<int> inputs(kInputs);
    for (int input = 0; input < kInputs; ++input) inputs[static_cast<std::size_t>(input)] = input;
    for (const int first : {0, int{kMask}, int{kPreviousAction}})
      std::swap(inputs[static_cast<std::size_t>(first + kLeft)], inputs[static_cast<std::size_t>(first + kRight)]);
    return inputs;
  }

  Motion<S> motion_by(const S* slip, const S* kidnap) const {
    return {slip ? learned_probability(*slip) : motion_.slip(),
            std::max(kidnap ? learned_probability(*kidnap) : S(0), motion_.kidnap()), motion_.limit()};
  }

  static void load(const Eigen::Ref<const Vector<S>>& state, int states, Walker& walker) {
    const auto count = [](S value) { return value > 0 ? static_cast<int>(std::min(value, S(1e6))) : 0; };
    walker.belief.load(state.head(SparseBelief<S>::kStateSize), states);
    walker.turns = count(state(kTurns));
    walker.count = static_cast<std::size_t>(count(state(kViews)));
    walker.views.clear();
    for (std::size_t i = 0; i < std::min<std::size_t>(walker.count, kRemembered); ++i)
      walker.views.push_back(
          static_cast<int>(std::clamp(state(kFirstView + static_cast<std::ptrdiff_t>(i)), S(-1e9), S(1e9))));
  }
  static void store(const Walker& walker, Eigen::Ref<Vector<S>> state) {
    state.setZero();
    walker.belief.store(state.head(SparseBelief<S>::kStateSize));
    state(kTurns) = static_cast<S>(walker.turns);
    state(kViews) = static_cast<S>(walker.count);
    for (std::size_t i = 0; i < walker.views.size(); ++i)
      state(kFirstView + static_cast<std::ptrdiff_t>(i)) = static_cast<S>(walker.views[i]);
  }
  /// Returns whether a view was not seen in the episode before, and remembers it.
  static bool is_new(Walker& walker, int view) {
    if (view == -1) return true;  // nobody knows
    if (std::find(walker.views.begin(), walker.views.end(), view) != walker.views.end()) return false;
    if (walker.views.size() < kRemembered)
      walker.views.push_back(view);
    else
      walker.views[walker.count % kRemembered] = view;
    ++walker.count;
    return true;
  }

  /// Moves beliefs and sees, step by step. Sets the head's inputs, what is masked beside the mask, and the state after
  /// the last step.
  void filter(const ForwardPass<S>& pass, Work& work) const {
    const NetworkInputs<S>& inputs = pass.inputs;
    const auto agents = static_cast<std::size_t>(inputs.agents);
    const auto tensor = [&](std::optional<std::size_t> of) { return of ? pass.tensors[*of].value().data() : nullptr; };
    const Motion<S> motion = motion_by(tensor(slip_), tensor(kidnap_));
    work.filter.set_motion(motion.slip(), motion.kidnap());
    work.walkers.resize(agents);
    work.steps.resize(agents);
    work.seen.setZero(kInputs, static_cast<std::ptrdiff_t>(inputs.goal.size()));
    work.guard.setZero(kActions, work.seen.cols());
    for (std::size_t begin = 0; begin < inputs.goal.size(); begin += agents) {
      for (std::size_t agent = 0; agent < agents; ++agent) {
        const std::size_t column = begin + agent;
        Walker& walker = work.walkers[agent];
        if (begin == 0 && !inputs.first[column])
          load(pass.state.value().col(static_cast<std::ptrdiff_t>(agent)), map_->states(), walker);
        const std::uint8_t previous = inputs.previous_action[column];
        if (inputs.first[column]) {
          walker.count = 0;
          walker.views.clear();
        }
        walker.turns = TurnGuard::after(walker.turns, previous);
        SparseStep<S>& step = work.steps[agent];
        step.before = &walker.belief;
        step.seen = inputs.seen[column];
        step.goal = inputs.goal[column];
        step.action = previous;
        step.allowed = inputs.allowed[column];
        step.first = inputs.first[column];
        step.repeated = !is_new(walker, inputs.view(column));
      }
      work.filter.advance(inputs.features, inputs.frames, kEvidence, kTempering, work.steps);
      for (std::size_t agent = 0; agent < agents; ++agent) {
        const std::size_t column = begin + agent;
        tell(column, work.steps[agent], work);
        if (guard_.must_go(work.walkers[agent].turns, inputs.allowed[column]))
          for (const int turn : {kLeft, kRight})
            work.guard(turn, static_cast<std::ptrdiff_t>(column)) = static_cast<S>(kMasked);
        std::swap(work.walkers[agent].belief, work.steps[agent].after);
      }
    }
    work.after.resize(kState, inputs.agents);
    for (std::size_t agent = 0; agent < agents; ++agent)
      store(work.walkers[agent], work.after.col(static_cast<std::ptrdiff_t>(agent)));
  }

  /// Sets what the head is told of a step.
  void tell(std::size_t column, const SparseStep<S>& step, Work& work) const {
    auto seen = work.seen.col(static_cast<std::ptrdiff_t>(column));
    const auto share_by_action = votes(step, work.fields.to(step.goal), *map_);
    for (int action = 0; action < kActions; ++action) seen(action) = 3 * share_by_action[action];
    for (const S share : step.shares) {
      seen(kSharpness) += share * share;
      seen(kLargest) = std::max(seen(kLargest), share);
    }
    seen(kNew) = step.repeated ? S(0) : S(1);
    for (int action = 0; action < kActions; ++action)
      seen(kMask + action) = static_cast<S>(!(step.allowed >> action & 1));
    if (step.action < kActions) seen(kPreviousAction + step.action) = S(0.5);
  }

  std::shared_ptr<const StateMap> map_;
  float goal_radius_;
  TurnGuard guard_;
  PlaceKeys<S> keys_;
  Motion<S> motion_;
  std::size_t directness_;
  std::optional<std::size_t> slip_, kidnap_;  ///< tensors of what is learned
  Layer first_, second_, policy_, value_;
};

}  // namespace

template <class S>
std::unique_ptr<AgentNetwork<S>> make_street_filter(const Parameters& parameters, const NetworkTask& task) {
  return std::make_unique<StreetFilter<S>>(parameters, task);
}

template std::unique_ptr<AgentNetwork<NetworkScalar>> make_street_filter(const Parameters&, const NetworkTask&);

}  // namespace citylearn
