// SPDX-License-Identifier: Apache-2.0
#include "env_service/matching/descriptor_match.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "env_service/matching/monotone_path.h"

namespace citylearn {
namespace {

using Matrix = Eigen::MatrixXf;
using Vector = Eigen::VectorXf;

constexpr int kMaxBlocks = 1024;      // of a recording in the coarse matrix
constexpr int kMaxSideways = 2;       // columns of a picture by which two cameras may differ
constexpr int kSidewaysFrames = 256;  // that tell by how many
constexpr int kRefinements = 3;       // of the threshold
// Of a threshold: its place between the mean similarity of the best path through a recording that was driven the other
// way and that of the path found. Chosen, as kSceneChange and PathOptions::gap, with summer and fall of Nordland and of
// drawn cities, as they are and with noise.
constexpr float kThreshold = 0.25F;
constexpr float kSceneChange = 25;  // sum of the changes between frames, in root mean squares, over which a scene lasts
constexpr float kClear = 3;         // times the score of that best path

/// Returns the columns without what those of a scene have in common, as the light or snow, at unit length; zeros where
/// nothing is left. A frame counts by how much it differs from the one before, so a stop does not become the scene.
Matrix directions(const Matrix& columns) {
  const Matrix centred = columns.colwise() - columns.rowwise().mean().eval();
  const auto frames = centred.cols();
  const float change_of_scene = kSceneChange * centred.norm() / std::sqrt(static_cast<float>(frames)) + 1e-9F;
  Matrix result = centred;
  for (const Eigen::Index step : {1, -1}) {  // what came before is half of the scene, what follows the other half
    Vector scene = Vector::Zero(centred.rows());
    for (Eigen::Index i = 1, frame = step > 0 ? 1 : frames - 2; i < frames; ++i, frame += step) {
      const float change = (centred.col(frame) - centred.col(frame - step)).norm();
      scene += std::min(1.F, change / change_of_scene) * (centred.col(frame) - scene);
      result.col(frame) -= 0.5F * scene;
    }
  }
  const Vector lengths = result.colwise().norm().transpose().cwiseMax(1e-9F);
  return result * lengths.cwiseInverse().asDiagonal();
}

/// Similarities of two recordings' frames in standard deviations above the mean, of the mean of both frames'.
class Similarities {
 public:
  Similarities(Matrix one, Matrix other) : one_(std::move(one)), other_(std::move(other)) {
    standards(one_, other_, one_mean_, one_scale_);
    standards(other_, one_, other_mean_, other_scale_);
  }
  int rows() const { return static_cast<int>(one_.cols()); }
  int columns() const { return static_cast<int>(other_.cols()); }
  Matrix of(int row, int rows, int column, int columns) const {
    const Matrix cosine = one_.middleCols(row, rows).transpose() * other_.middleCols(column, columns);
    const Matrix by_row =
        one_scale_.segment(row, rows).asDiagonal() * (cosine.colwise() - one_mean_.segment(row, rows));
    return 0.5F * (by_row + (cosine.rowwise() - other_mean_.segment(column, columns).transpose()) *
                                other_scale_.segment(column, columns).asDiagonal());
  }

 private:
  /// Computes mean and 1 / standard deviation of the similarities of each of `frames` to all of `others`.
  static void standards(const Matrix& frames, const Matrix& others, Vector& mean, Vector& scale) {
    const Vector middle = others.rowwise().mean();
    const Matrix covariance =
        others * others.transpose() / static_cast<float>(others.cols()) - middle * middle.transpose();
    mean = frames.transpose() * middle;
    scale = (covariance * frames).cwiseProduct(frames).colwise().sum().transpose().cwiseMax(1e-8F).cwiseSqrt();
    scale = scale.cwiseInverse().eval();
  }

  Matrix one_, other_;
  Vector one_mean_, one_scale_, other_mean_, other_scale_;
};

/// Returns the similarities of blocks of `block` x `block` frames: the mean of each frame's best in the other's block,
/// standardised anew.
Matrix coarse(const Similarities& fine, int block) {
  const auto blocks = [&](int frames) { return (frames + block - 1) / block; };
  Matrix result(blocks(fine.rows()), blocks(fine.columns()));
  for (int row = 0; row < result.rows(); ++row) {
    const Matrix part = fine.of(row * block, std::min(block, fine.rows() - row * block), 0, fine.columns());
    for (int column = 0; column < result.cols(); ++column) {
      const auto cell = part.middleCols(column * block, std::min(block, fine.columns() - column * block));
      result(row, column) = 0.5F * (cell.rowwise().maxCoeff().mean() + cell.colwise().maxCoeff().mean());
    }
  }
  const auto standardised = [](Matrix rows) {
    rows.colwise() -= rows.rowwise().mean().eval();
    const Vector deviation = rows.array().square().rowwise().mean().sqrt().max(1e-6F);
    return Matrix(deviation.cwiseInverse().asDiagonal() * rows);
  };
  return 0.5F * (standardised(result) + standardised(result.transpose()).transpose());
}

/// Similarities, and the band of them in which to look for a path.
struct Search {
  RowScores scores;
  Band band;
};

Search whole(const Matrix& matrix) {
  return {[&matrix](int row, int begin, int end, float* to) {
            Eigen::Map<Eigen::RowVectorXf>(to, end - begin) = matrix.row(row).segment(begin, end - begin);
          },
          {std::vector<int>(static_cast<std::size_t>(matrix.rows()), 0),
           std::vector<int>(static_cast<std::size_t>(matrix.rows()), static_cast<int>(matrix.cols()))}};
}

float mean_similarity(const MonotonePath& path, const RowScores& scores) {
  double sum = 0;
  for (const auto& [row, column] : path.pairs) {
    float one = 0;
    scores(row, column, column + 1, &one);
    sum += one;
  }
  return path.pairs.empty() ? 0 : static_cast<float>(sum / static_cast<double>(path.pairs.size()));
}

struct Found {
  MonotonePath path, chance;  ///< chance: the best in the recording that runs the other way
  bool clear = false;
  float by_chance = 0;  ///< mean similarity of `chance`
};

MonotonePath without_gaps(const Search& search) {
  return best_monotone_path(search.band, search.scores, {.threshold = 0, .gap = 1e20F});
}

/// A path finds something to follow in any two recordings: how much shows the one that goes the other way.
Found find(const Search& forwards, const Search& backwards) {
  Found found;
  found.chance = without_gaps(backwards);
  found.path = without_gaps(forwards);
  const float chance = found.by_chance = mean_similarity(found.chance, backwards.scores);
  PathOptions options;
  for (int i = 0; i < kRefinements; ++i) {
    options.threshold = chance + kThreshold * std::max(0.F, mean_similarity(found.path, forwards.scores) - chance);
    found.path = best_monotone_path(forwards.band, forwards.scores, options);
  }
  found.clear = found.path.score > kClear * best_monotone_path(backwards.band, backwards.scores, options).score;
  return found;
}

/// Returns by how many columns of a picture `other` sees things farther to the left.
int sideways(const Matrix& one, const Matrix& other, int column) {
  int best = 0;
  float most = -1;
  const auto step = std::max<Eigen::Index>(1, one.cols() / kSidewaysFrames);
  for (int shift = -kMaxSideways; column > 0 && shift <= kMaxSideways; ++shift) {
    const Eigen::Index kept = one.rows() - static_cast<Eigen::Index>(std::abs(shift)) * column;
    const Matrix some = one(Eigen::seqN(shift > 0 ? one.rows() - kept : 0, kept), Eigen::seq(0, one.cols() - 1, step));
    const Similarities similarities(directions(some),
                                    directions(shift > 0 ? other.topRows(kept) : other.bottomRows(kept)));
    const float mean = similarities.of(0, similarities.rows(), 0, similarities.columns()).rowwise().maxCoeff().mean();
    if (mean > most) {
      most = mean;
      best = shift;
    }
  }
  return best;
}

}  // namespace

DescriptorMatch match_descriptors(const Eigen::MatrixXf& one, const Eigen::MatrixXf& other, int column) {
  const int shift = sideways(one, other, column);
  const Eigen::Index kept = one.rows() - static_cast<Eigen::Index>(std::abs(shift)) * column;
  const Similarities fine(directions(shift > 0 ? one.bottomRows(kept) : one.topRows(kept)),
                          directions(shift > 0 ? other.topRows(kept) : other.bottomRows(kept)));
  const int rows = fine.rows(), columns = fine.columns();
  const int block = (std::max(rows, columns) + kMaxBlocks - 1) / kMaxBlocks;
  const Matrix blocks = block == 1 ? fine.of(0, rows, 0, columns) : coarse(fine, block);
  const Matrix reversed = blocks.rowwise().reverse();
  Search forwards = whole(blocks), backwards = whole(reversed);
  Found found = find(forwards, backwards);
  if (block > 1) {
    forwards = {[&](int row, int begin, int end, float* to) {
                  Eigen::Map<Eigen::RowVectorXf>(to, end - begin) = fine.of(row, 1, begin, end - begin);
                },
                band_about(found.path, block, rows, columns)};
    backwards = {[&](int row, int begin, int end, float* to) {
                   Eigen::Map<Eigen::RowVectorXf>(to, end - begin) =
                       fine.of(row, 1, columns - end, end - begin).rowwise().reverse();
                 },
                 band_about(found.chance, block, rows, columns)};
    found = find(forwards, backwards);
  }
  DescriptorMatch match{found.path.pairs, {}, found.clear};
  const float usual = std::max(1e-3F, mean_similarity(found.path, forwards.scores) - found.by_chance);
  for (const auto& [row, at] : match.pairs) {
    float similarity = 0;
    forwards.scores(row, at, at + 1, &similarity);
    match.confidence.push_back(std::clamp((similarity - found.by_chance) / usual, 0.F, 1.F));
  }
  return match;
}

}  // namespace citylearn
