// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/recognition/evaluation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "core/util/error.h"
#include "core/util/random.h"

namespace citylearn {
namespace {

constexpr float kNone = -std::numeric_limits<float>::infinity();

std::vector<int> surest_first(const Answers& answers) {
  std::vector<int> order;
  for (int q = 0; q < answers.queries(); ++q)
    if (answers.nearest[q] >= 0) order.push_back(q);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return answers.confidence[a] > answers.confidence[b]; });
  return order;
}

/// Each query counts `weight[q]` times.
PrecisionRecall weighted_curve(const Answers& answers, const std::vector<int>& order, const std::vector<int>& weight) {
  double answerable = 0;
  for (int q = 0; q < answers.queries(); ++q) answerable += answers.answerable[q] ? weight[q] : 0;
  PrecisionRecall curve;
  if (answerable == 0) return curve;
  double right = 0, accepted = 0, last_recall = 0, last_precision = -1;
  for (std::size_t i = 0; i < order.size();) {
    const float confidence = answers.confidence[order[i]];
    // Equal confidences are one threshold: no threshold tells them apart.
    for (; i < order.size() && answers.confidence[order[i]] == confidence; ++i) {
      accepted += weight[order[i]];
      right += answers.rank[order[i]] == 0 ? weight[order[i]] : 0;
    }
    if (accepted == 0) continue;
    const double precision = right / accepted, recall = right / answerable;
    if (last_precision < 0) last_precision = precision;
    curve.auc += (recall - last_recall) * (precision + last_precision) / 2;
    if (right == accepted) curve.recall_at_full_precision = recall;
    curve.confidence.push_back(confidence);
    curve.precision.push_back(last_precision = precision);
    curve.recall.push_back(last_recall = recall);
  }
  return curve;
}

/// Adds the answers of a block of R x n scores to those of the queries before it.
void add_answers(Answers& answers, const Eigen::Ref<const Eigen::MatrixXf>& block, const GroundTruth& truth) {
  Eigen::VectorXf placed;  // a copy, only where some references are no answers
  for (const auto scores : block.colwise()) {
    if (!truth.unplaced_references().empty()) placed = scores;
    for (const int reference : truth.unplaced_references()) placed[reference] = kNone;
    const Eigen::Map<const Eigen::VectorXf> column(placed.size() > 0 ? placed.data() : scores.data(), scores.size());
    const int query = answers.queries();
    const float *begin = column.data(), *end = begin + column.size();
    float best = column.maxCoeff<Eigen::PropagateNumbers>(), best_right = kNone;
    if (!(best > kNone)) best = kNone;
    const std::vector<int> right = truth.right_frames(query);
    for (const int r : right) best_right = std::max(best_right, column[r]);
    int rank = Answers::kNever;
    if (best_right > kNone) {
      rank = 0;
      for (const float* score = begin; score != end; ++score) rank += *score >= best_right;
      for (const int r : right) rank -= column[r] >= best_right;
    }
    const bool judged = best > kNone && !truth.left_out(query);
    answers.nearest.push_back(judged ? static_cast<int>(std::find(begin, end, best) - begin) : -1);
    answers.confidence.push_back(best);
    answers.rank.push_back(rank);
    answers.answerable.push_back(!right.empty());
  }
}

}  // namespace

GroundTruth GroundTruth::by_index(int references, int queries, int tolerance) {
  std::vector<std::pair<int, int>> matches;
  for (int i = 0; i < std::min(references, queries); ++i) matches.push_back({i, i});
  return by_matches(matches, references, queries, tolerance);
}

GroundTruth GroundTruth::by_matches(const std::vector<std::pair<int, int>>& matches, int references, int queries,
                                    int tolerance) {
  if (tolerance < 0) throw Error("the tolerance cannot be negative");
  GroundTruth truth;
  truth.references_ = references;
  truth.tolerance_ = tolerance;
  truth.frames_.resize(static_cast<std::size_t>(queries));
  truth.left_out_.resize(static_cast<std::size_t>(queries));
  for (const auto& [reference, query] : matches) {
    if (reference < 0 || reference >= references || query < 0 || query >= queries)
      throw Error("the match of reference frame " + std::to_string(reference) + " and query frame " +
                  std::to_string(query) + " is outside of " + std::to_string(references) + " and " +
                  std::to_string(queries) + " frames");
    truth.frames_[query].push_back(reference);
  }
  for (std::vector<int>& frames : truth.frames_) std::sort(frames.begin(), frames.end());
  return truth;
}

void GroundTruth::leave_out(int query) {
  frames_[static_cast<std::size_t>(query)].clear();
  left_out_[static_cast<std::size_t>(query)] = true;
}

std::vector<int> GroundTruth::right_frames(int query) const {
  std::vector<int> right;
  for (const int frame : frames_[query])
    for (int r = std::max(right.empty() ? 0 : right.back() + 1, frame - tolerance_);
         r <= std::min(references_ - 1, frame + tolerance_); ++r)
      right.push_back(r);
  return right;
}

bool GroundTruth::answerable(int query) const { return !frames_[query].empty(); }

int GroundTruth::place(int query) const {
  const std::vector<int>& frames = frames_[query];
  return frames.empty() ? -1 : frames[frames.size() / 2];
}

Answers answers(const Scores& scores, const GroundTruth& truth) {
  if (scores.references() != truth.references() || scores.queries() != truth.queries())
    throw Error("similarities of " + std::to_string(scores.references()) + " x " + std::to_string(scores.queries()) +
                " frames, ground truth of " + std::to_string(truth.references()) + " x " +
                std::to_string(truth.queries()));
  Answers result;
  scores.for_each_block([&](Eigen::Index, const Eigen::MatrixXf& block) { add_answers(result, block, truth); });
  return result;
}

double recall_at(const Answers& answers, int n) {
  double right = 0, answerable = 0;
  for (int q = 0; q < answers.queries(); ++q) {
    answerable += answers.answerable[q];
    right += answers.answerable[q] && answers.rank[q] < n;
  }
  return right / answerable;
}

Interval wilson_interval(double successes, double trials) {
  if (trials <= 0) return {};
  constexpr double kZ = 1.959963984540054;  // 97.5 % of the normal distribution
  const double share = successes / trials, scale = 1 + kZ * kZ / trials;
  const double centre = share + kZ * kZ / (2 * trials);
  const double spread = kZ * std::sqrt(share * (1 - share) / trials + kZ * kZ / (4 * trials * trials));
  return {std::max(0.0, (centre - spread) / scale), std::min(1.0, (centre + spread) / scale)};
}

PrecisionRecall precision_recall(const Answers& answers) {
  return weighted_curve(answers, surest_first(answers), std::vector<int>(answers.rank.size(), 1));
}

Interval auc_interval(const Answers& answers, std::uint64_t seed, int resamples) {
  const int queries = answers.queries();
  if (queries == 0 || resamples < 1) return {};
  const int block = static_cast<int>(std::ceil(std::sqrt(queries)));
  const std::vector<int> order = surest_first(answers);
  Random random{seed, 0x417563ull};
  std::vector<double> areas;
  std::vector<int> weight;
  for (int i = 0; i < resamples; ++i) {
    weight.assign(answers.rank.size(), 0);
    for (int drawn = 0; drawn < queries;) {
      const int first = static_cast<int>(random.below(static_cast<std::uint64_t>(queries)));
      for (int k = 0; k < block && drawn < queries; ++k, ++drawn) ++weight[(first + k) % queries];
    }
    areas.push_back(weighted_curve(answers, order, weight).auc);
  }
  std::sort(areas.begin(), areas.end());
  const auto at = [&](double share) { return areas[static_cast<std::size_t>(std::lround(share * (resamples - 1)))]; };
  return {at(0.025), at(0.975)};
}

}  // namespace citylearn
