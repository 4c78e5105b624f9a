// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <utility>
#include <vector>

namespace citylearn {

/// The cells of a matrix of similarities through which a path may go: columns begin[r] to end[r], not included, of row
/// r. Neither ever decreases.
struct Band {
  std::vector<int> begin, end;
};

/// Writes the similarities of a row's columns `begin` to `end` to `to`.
using RowScores = std::function<void(int row, int begin, int end, float* to)>;

struct PathOptions {
  float threshold = 0;  ///< similarity that a pair has at least to be worth a place on the path
  float gap = 20;       ///< what ending the path and going on elsewhere costs
  float turn = 0.5F;    ///< what a step along one recording alone costs
};

/// A path that goes back in neither recording: pairs (row, column), each a step along one or both after the one before,
/// or, behind a gap, further on in both.
struct MonotonePath {
  std::vector<std::pair<int, int>> pairs;
  float score = 0;  ///< sum over the steps, twice for those along both, of similarity less threshold, less costs
};

/// Returns the path of the greatest score. It begins and ends anywhere (dynamic programming, as Smith & Waterman 1981
/// with gaps that cost the same however long). Needs a byte a cell.
MonotonePath best_monotone_path(const Band& band, const RowScores& similarities, const PathOptions& options);

/// Returns the band about a path through a matrix whose cells stand for `block` x `block` cells of one of rows x
/// columns.
Band band_about(const MonotonePath& path, int block, int rows, int columns);

}  // namespace citylearn
