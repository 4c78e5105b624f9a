// SPDX-License-Identifier: Apache-2.0
#include <map>
#include <optional>
#include <span>
#include <unordered_set>
#include <utility>

#include "policy_service/network/agents/place_filter.h"
#include "policy_service/network/agents/sparse_inputs.h"
#include "policy_service/network/belief/motion.h"
#include "policy_service/network/belief/place_keys.h"
#include "policy_service/network/belief/sparse_filter.h"
#include "policy_service/network/belief/street_votes.h"
#include "policy_service/rollout/belief.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/evaluated_tasks.h"

namespace citylearn {
namespace {

/// A Bayes filter over the places of the route, without anything learned: uniform at first, moved by the known action.
/// What is seen weighs exp(s / (1 + h t) x . K_i) for place i, with x and K as FeatureNormaliser makes them: t steps
/// into the episode evidence counts for less, as neighbouring frames err alike. The goal, where the episode would have
/// ended, and places where other actions would be allowed are excluded, for the rest of the episode. Walks to the side
/// of the goal where the belief, each place weighed by 1 / distance^g, is heavier, because a wrong turn costs most in
/// proportion when the goal is near; the side that asks for turning about is weighed by u, because doubt alone is no
/// reason to turn. On a long line the belief is sparse, as place_filter's.
///
/// On streets the belief is over their states and always sparse. A view counts once in an episode: one that errs
/// would err each time. Takes the action that leads nearer to the goal for most of the belief, and goes
/// forward where TurnGuard says so.
class SequenceFilter : public Policy {
 public:
  SequenceFilter(const ControlTask& task, const Parameters& parameters, bool knows_goals)
      : task_{task.first_frame, task.frames, {}, task.sparse_from, task.streets, task.goal_radius},
        evidence_(parameters["evidence"]),
        tempering_(parameters["tempering"]),
        turning_(parameters["turning"]),
        motion_(parameters["slip"], parameters["kidnap"]),
        knows_goals_(knows_goals),
        sparse_(task.streets || task.frames >= task.sparse_from),
        normaliser_(task.reference) {
    if (task.reference.size() == 0)
      throw Error("needs the features of the training traversal", "sequence_filter",
                  "start an env_service on a traversal that has features");
    weights_ = Vector<double>::LinSpaced(task.frames, 1, task.frames).array().pow(-parameters["nearness"]);
    keys_.emplace(task.reference, static_cast<int>(task.reference.rows()), task.frames, sparse_);
    dimension_ = task.reference.rows();
    if (!sparse_) return;
    sparse_filter_.emplace(
        *keys_, Motion<float>(parameters["slip"], parameters["kidnap"]), task.streets, task.goal_radius,
        task.streets ? static_cast<std::size_t>(task.frames) : std::size_t{SparseBelief<float>::kMaxActive});
    if (task.streets) {
      fields_.emplace(*task.streets, task.goal_radius);
      guard_.emplace(*task.streets);
      return;
    }
    inputs_.set_nearness(static_cast<float>(parameters["nearness"]), task.frames);
  }

  void begin(std::uint32_t first_task, const SeenFeatures& known) override { tasks_.begin(first_task, known); }
  std::map<std::uint32_t, SeenFeatures> seen() const override { return tasks_.seen(); }

  void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) override {
    const std::size_t agents = observation.goal().size();
    if (observation.feature_dimension() != static_cast<std::uint32_t>(dimension_))
      throw Error(std::to_string(observation.feature_dimension()) + " features, the reference has " +
                      std::to_string(dimension_),
                  "traversal " + std::string(observation.traversal().c_str()));
    if (agents_.size() != agents) agents_.assign(agents, {Vector<double>::Zero(sparse_ ? 0 : task_.frames)});
    choice.assign(agents, kStay);
    tasks_.follow(observation);
    for (const EvaluatedTasks::Batch& batch : tasks_.batches()) {
      look(observation, batch);
      if (sparse_) {
        walk_sparsely(observation, batch, choice);
        continue;
      }
      keys_->compare(seen_, task_.frames, similarities_, similarity_);
      EvaluatedTasks::each_agent(batch, [&](int column, int agent) {
        choice[static_cast<std::size_t>(agent)] = walk(observation, static_cast<std::size_t>(agent), column);
      });
    }
  }

  void believe(msg::Belief& belief) const override {
    for (const Agent& agent : agents_)
      add_belief(sparse_ ? agent.sparse.scores(task_.frames) : agent.belief.cast<float>(), task_.first_frame, belief,
                 task_.streets.get());
  }

 private:
  // Beliefs are logarithms. Nothing that is seen outweighs an exclusion.
  static constexpr double kExclusion = 1e4, kNever = -100 * kExclusion;

  struct Agent {
    Vector<double> belief;  ///< N; empty where it is sparse
    double steps = 0;       ///< of its episode, as Motion counts them
    int goal = 0;
    SparseBelief<float> sparse = {};
    // On streets:
    std::unordered_set<std::uint32_t> frames = {};  ///< seen in its episode
    KnownGoals known = {};                          ///< beyond the present one by knows_goals_ alone
    int turns = 0;                                  ///< in a row
  };

  /// Normalises what the agents of a batch see.
  void look(const msg::Observation& observation, const EvaluatedTasks::Batch& batch) {
    const Eigen::Map<const Matrix<float>> features(observation.features().data(), dimension_,
                                                   static_cast<std::ptrdiff_t>(agents_.size()));
    seen_.setZero(features.rows(), EvaluatedTasks::kColumns);
    EvaluatedTasks::each_agent(batch, [&](int column, int agent) {
      seen_.col(column) = features.col(agent);
      tasks_.normalise(normaliser_, agent, seen_.col(column));
    });
  }

  void walk_sparsely(const msg::Observation& observation, const EvaluatedTasks::Batch& batch,
                     std::vector<std::uint8_t>& choice) {
    steps_.resize(EvaluatedTasks::kColumns);
    std::size_t count = 0;
    EvaluatedTasks::each_agent(batch, [&](int column, int agent) {
      const auto index = static_cast<std::size_t>(agent);
      SparseStep<float>& step = steps_[count++];
      step.before = &agents_[index].sparse;
      step.seen = column;
      step.goal = static_cast<int>(observation.goal()[index]) - task_.first_frame;
      step.action = observation.previous_action()[index];
      step.allowed = observation.allowed()[index];
      step.first = observation.flags()[index] & msg::FLAG_FIRST;
      if (fields_) note_view(observation, index, step);
    });
    sparse_filter_->advance(seen_, task_.frames, static_cast<float>(evidence_), static_cast<float>(tempering_),
                            std::span(steps_).first(count));
    const auto turning = static_cast<float>(turning_);
    count = 0;
    EvaluatedTasks::each_agent(batch, [&](int, int agent) {
      SparseStep<float>& step = steps_[count++];
      std::swap(agents_[static_cast<std::size_t>(agent)].sparse, step.after);
      if (fields_) {
        choice[static_cast<std::size_t>(agent)] = vote(step, agents_[static_cast<std::size_t>(agent)]);
        return;
      }
      const auto sides = inputs_.read(
          step, task_.frames, {step.action == kPrevious ? turning : 1, step.action == kNext ? turning : 1}, said_);
      choice[static_cast<std::size_t>(agent)] =
          allowed_or_turn(sides.before > sides.after ? kNext : kPrevious, step.allowed);
    });
  }

  void note_view(const msg::Observation& observation, std::size_t index, SparseStep<float>& step) {
    Agent& agent = agents_[index];
    if (step.first) agent.frames.clear();
    if (step.first || step.arrived()) {
      if (knows_goals_)
        agent.known.follow(task_, *fields_, observation, index);
      else
        agent.known.way = fields_->to(step.goal);
    }
    agent.turns = TurnGuard::after(agent.turns, step.action);
    step.repeated = !agent.frames.insert(observation.frame()[index]).second;
  }

  std::uint8_t vote(const SparseStep<float>& step, const Agent& agent) const {
    if (guard_->must_go(agent.turns, step.allowed)) return kForward;
    const auto share = votes(step, agent.known.way, *task_.streets);
    std::uint8_t best = kNoAction;
    for (const std::uint8_t action : kStreetActions)
      if (step.allowed >> action & 1 && (best == kNoAction || share[action] > share[best])) best = action;
    return best;
  }

  std::uint8_t walk(const msg::Observation& observation, std::size_t index, int column) {
    Agent& agent = agents_[index];
    const int goal = static_cast<int>(observation.goal()[index]) - task_.first_frame;
    const std::uint8_t allowed = observation.allowed()[index], previous = observation.previous_action()[index];
    if (observation.flags()[index] & msg::FLAG_FIRST) {
      agent.belief.setZero();
      agent.steps = 0;
    } else if (agent.goal != goal) {  // it is there
      agent.belief.setConstant(-kExclusion);
      agent.belief(agent.goal) = 0;
      agent.steps = motion_.later(agent.steps);
    } else {
      before_ = agent.belief;
      motion_.move_scores(previous, before_, agent.belief, kNever);
      agent.steps = motion_.later(agent.steps);
    }
    agent.goal = goal;
    agent.belief += evidence_ / (1 + tempering_ * agent.steps) * similarity_.col(column).cast<double>();
    exclude(goal, task_.frames, allowed, kExclusion, agent.belief);
    odds_ = (agent.belief.array() - agent.belief.maxCoeff()).exp();
    return heavier_side(goal, previous, allowed);
  }

  std::uint8_t heavier_side(int goal, std::uint8_t previous, std::uint8_t allowed) const {
    const std::ptrdiff_t rest = odds_.size() - goal - 1;
    double before = odds_.head(goal).dot(weights_.head(goal).reverse());
    double after = odds_.tail(rest).dot(weights_.head(rest));
    if (previous == kPrevious) before *= turning_;
    if (previous == kNext) after *= turning_;
    return allowed_or_turn(before > after ? kNext : kPrevious, allowed);
  }

  ControlTask task_;              ///< without the reference, of which keys_ are made
  std::ptrdiff_t dimension_ = 0;  ///< D
  double evidence_, tempering_, turning_;
  Motion<double> motion_;
  bool knows_goals_;  ///< on streets those to come
  bool sparse_;       ///< beliefs are
  FeatureNormaliser normaliser_;
  Vector<double> weights_;  ///< N, of places at distances from 1 on to the goal
  std::optional<PlaceKeys<float>> keys_;
  EvaluatedTasks tasks_;
  std::vector<Agent> agents_;
  Matrix<float> seen_;                       ///< D x columns of a batch
  Matrix<float> similarities_, similarity_;  ///< EN x columns, N x columns
  Vector<double> before_, odds_;             ///< N
  std::optional<DistanceFields> fields_;     ///< on streets
  std::optional<TurnGuard> guard_;           ///< likewise
  std::optional<SparseFilter<float>> sparse_filter_;
  std::vector<SparseStep<float>> steps_;  ///< of a batch
  place_filter::SparseInputs<float> inputs_;
  Vector<float> said_ = Vector<float>::Zero(place_filter::kInputs);
};

template <bool kKnowsGoals>
std::unique_ptr<Policy> make(const Parameters& parameters, const ControlTask& task) {
  return std::make_unique<SequenceFilter>(task, parameters, kKnowsGoals);
}

std::vector<ParameterSpec> filter_parameters() {
  std::vector<ParameterSpec> specs = Motion<double>::parameters();
  specs.insert(specs.end(),
               {{"evidence", "s, how much the first frame of an episode counts", 16, 0.01, 1000},
                {"tempering", "h, how fast later frames count for less: s / (1 + h t), t in steps", 0.15, 0, 1000},
                {"nearness", "g, places on a line are weighed by 1 / distance^g to the goal", 0.6, 0, 10},
                {"turning", "u, on a line the side that asks for turning about is weighed by this", 0.3, 0, 1}});
  return specs;
}

const ControlRegistry::Registration sequence_filter_registration({
    "sequence_filter",
    "Bayes filter over the training traversal's places, nothing learned, then the heavier side",
    filter_parameters(),
    make<false>,
});

const ControlRegistry::Registration oracle_filter_registration({
    "oracle_filter",
    "cheats: sequence_filter that knows the features of the traversal itself and, on streets, goals to come; the bound "
    "of what filters can do",
    filter_parameters(),
    make<true>,
});

}  // namespace
}  // namespace citylearn
