// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/recognition/sequence.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/util/error.h"

namespace citylearn {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

void check_velocities(double slowest, double fastest) {
  if (!(slowest >= 0.1 && slowest <= fastest && fastest <= 10))
    throw Error("velocities of a sequence must be in 0.1..10, the slowest first");
}

/// Velocities at which a line `length` query frames long ends one reference frame apart. Without a range: that one.
std::vector<double> velocities_between(double slowest, double fastest, int length) {
  check_velocities(slowest, fastest);
  if (length == 0 || slowest == fastest) return {slowest};
  std::vector<double> velocities;
  // A hair of tolerance: 1.2 * 10 must count as 12.
  for (int move = static_cast<int>(std::ceil(slowest * length - 1e-9)); move <= fastest * length + 1e-9; ++move)
    velocities.push_back(static_cast<double>(move) / length);
  if (velocities.empty()) velocities.push_back((slowest + fastest) / 2);
  return velocities;
}

/// Returns the mean along the line through each entry, over the frames `before` and `after` it that are inside.
Eigen::MatrixXf mean_along_lines(const Eigen::MatrixXf& similarity, const std::vector<double>& velocities, int before,
                                 int after) {
  const Eigen::Index rows = similarity.rows(), columns = similarity.cols();
  Eigen::MatrixXf best = Eigen::MatrixXf::Constant(rows, columns, -std::numeric_limits<float>::infinity());
  Eigen::VectorXf sum(rows), count(rows);
  for (const double velocity : velocities)
    for (Eigen::Index q = 0; q < columns; ++q) {
      sum.setZero();
      count.setZero();
      for (Eigen::Index k = std::max<Eigen::Index>(-before, -q); k <= std::min<Eigen::Index>(after, columns - 1 - q);
           ++k) {
        const Eigen::Index shift = std::lround(velocity * static_cast<double>(k));
        const Eigen::Index inside = rows - std::abs(shift);
        if (inside <= 0) continue;
        const Eigen::Index to = std::max<Eigen::Index>(0, -shift), from = std::max<Eigen::Index>(0, shift);
        sum.segment(to, inside) += similarity.col(q + k).segment(from, inside);
        count.segment(to, inside).array() += 1;
      }
      best.col(q) = best.col(q).cwiseMax(sum.cwiseQuotient(count));
    }
  return best;
}

}  // namespace

Scores sequence_similarity(Scores similarity, const SequenceOptions& options) {
  if (options.length < 1 || (!options.causal && options.length % 2 == 0))
    throw Error("a centred sequence has an odd number of frames");
  const int before = options.causal ? options.length - 1 : options.length / 2, after = options.causal ? 0 : before;
  const std::vector<double> velocities = velocities_between(options.slowest, options.fastest, before);
  const auto reach = static_cast<Eigen::Index>(std::ceil(velocities.back() * before));
  return transformed(std::move(similarity), {reach, before, after},
                     [=](const Eigen::MatrixXf& block, Eigen::Index, Eigen::Index) {
                       return mean_along_lines(block, velocities, before, after);
                     });
}

Eigen::VectorXd local_contrast(const Eigen::Ref<const Eigen::VectorXd>& difference, int window) {
  if (window < 1) throw Error("the window of the local contrast needs at least one frame");
  const Eigen::Index rows = difference.size(), half = std::min<Eigen::Index>(window / 2, rows - 1);
  Eigen::ArrayXd count = Eigen::ArrayXd::Zero(rows), mean = count, squares = count;
  // All windows at once: the frames `shift` after the windows' middles, for each shift.
  const auto for_each_shift = [&](const auto& add) {
    for (Eigen::Index shift = -half; shift <= half; ++shift)
      add(std::max<Eigen::Index>(0, -shift), std::max<Eigen::Index>(0, shift), rows - std::abs(shift));
  };
  for_each_shift([&](Eigen::Index to, Eigen::Index from, Eigen::Index inside) {
    mean.segment(to, inside) += difference.array().segment(from, inside);
    count.segment(to, inside) += 1;
  });
  mean /= count;
  for_each_shift([&](Eigen::Index to, Eigen::Index from, Eigen::Index inside) {
    squares.segment(to, inside) += (difference.array().segment(from, inside) - mean.segment(to, inside)).square();
  });
  squares /= count - 1;
  // Eigen's own root of several numbers at once is not exact.
  const auto deviation = squares.unaryExpr([](double x) { return std::sqrt(x); });
  return (squares > 0).select((difference.array() - mean) / deviation, 0);
}

double least_contrast(const Scores& scores, int window) {
  double least = kInfinity;
  scores.for_each_block([&](Eigen::Index, const Eigen::MatrixXf& block) {
    for (const auto column : block.colwise())
      least = std::min(least, local_contrast(-column.cast<double>(), window).minCoeff());
  });
  return least;
}

SeqSlam seqslam(const Eigen::Ref<const Eigen::MatrixXd>& difference, const SeqSlamOptions& options) {
  if (options.length < 2 || options.length % 2 != 0) throw Error("the length of a SeqSLAM trajectory must be even");
  if (options.window < 0) throw Error("the window around a SeqSLAM match cannot be negative");
  const Eigen::Index rows = difference.rows(), columns = difference.cols(), half = options.length / 2;
  const std::vector<double> velocities = velocities_between(options.slowest, options.fastest, options.length);
  SeqSlam result;
  result.costs = Eigen::MatrixXd::Constant(rows, columns, kInfinity);
  result.matches = Eigen::VectorXi::Constant(columns, -1);
  result.ratios = Eigen::VectorXd::Constant(columns, std::numeric_limits<double>::quiet_NaN());
  Eigen::VectorXd sum(rows);
  for (Eigen::Index q = half; q + half < columns; ++q) {
    // A trajectory begins at (start, q - half); its match is half a length further on.
    for (const double velocity : velocities) {
      const auto climb = [velocity](Eigen::Index k) {
        return static_cast<Eigen::Index>(std::floor(static_cast<double>(k) * velocity + 1e-9));
      };
      const Eigen::Index starts = std::min(rows - climb(options.length), rows - half);
      if (starts <= 0) continue;
      sum.head(starts).setZero();
      for (Eigen::Index k = 0; k <= options.length; ++k)
        sum.head(starts) += difference.col(q - half + k).segment(climb(k), starts);
      auto costs = result.costs.col(q).segment(half, starts);
      costs = costs.cwiseMin(sum.head(starts));
    }
    Eigen::Index best = 0;
    const double least = result.costs.col(q).minCoeff(&best);
    if (least == kInfinity) continue;
    result.matches[q] = static_cast<int>(best);
    double rival = kInfinity;
    for (Eigen::Index r = 0; r < rows; ++r)
      if (std::abs(r - best) > options.window / 2) rival = std::min(rival, result.costs(r, q));
    result.ratios[q] = rival > 0 ? least / rival : 1;
  }
  return result;
}

}  // namespace citylearn
