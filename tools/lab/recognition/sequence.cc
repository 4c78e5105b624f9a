// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/recognition/sequence.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

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

}  // namespace

Eigen::MatrixXf sequence_similarity(const Eigen::Ref<const Eigen::MatrixXf>& similarity,
                                    const SequenceOptions& options) {
  if (options.length < 1 || (!options.causal && options.length % 2 == 0))
    throw Error("a centred sequence has an odd number of frames");
  const Eigen::Index rows = similarity.rows(), columns = similarity.cols();
  const int before = options.causal ? options.length - 1 : options.length / 2;
  const int after = options.causal ? 0 : before;
  Eigen::MatrixXf best = Eigen::MatrixXf::Constant(rows, columns, -std::numeric_limits<float>::infinity());
  Eigen::VectorXf sum(rows), count(rows);
  for (const double velocity : velocities_between(options.slowest, options.fastest, before))
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

Eigen::MatrixXd local_contrast(const Eigen::Ref<const Eigen::MatrixXd>& difference, int window) {
  if (window < 1) throw Error("the window of the local contrast needs at least one frame");
  const Eigen::Index rows = difference.rows(), half = window / 2;
  Eigen::MatrixXd enhanced(rows, difference.cols());
  for (Eigen::Index q = 0; q < difference.cols(); ++q)
    for (Eigen::Index r = 0; r < rows; ++r) {
      const Eigen::Index from = std::max<Eigen::Index>(0, r - half);
      const Eigen::Index size = std::min<Eigen::Index>(rows, r + half + 1) - from;
      const auto around = difference.col(q).segment(from, size);
      const double mean = around.mean();
      const double squares = (around.array() - mean).square().sum();
      const double deviation = size > 1 ? std::sqrt(squares / static_cast<double>(size - 1)) : 0;
      enhanced(r, q) = deviation > 0 ? (difference(r, q) - mean) / deviation : 0;
    }
  if (enhanced.size() > 0) enhanced.array() -= enhanced.minCoeff();
  return enhanced;
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
