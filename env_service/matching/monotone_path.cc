// SPDX-License-Identifier: Apache-2.0
#include "env_service/matching/monotone_path.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace citylearn {
namespace {

constexpr float kNever = -1e30F;
constexpr int kMargin = 2;  // blocks about a path

/// Where a path's best score in a cell comes from, on the path (low four bits) and in a gap (high four).
enum From : std::uint8_t { kStart, kBoth, kGap, kRow, kColumn, kPath };

/// The best scores of the paths that end in each column of a row's part of the band.
struct Row {
  int begin = 0;
  std::vector<float> on_path = {}, in_gap = {};

  float path(int column) const { return of(on_path, column); }
  float gap(int column) const { return of(in_gap, column); }

 private:
  float of(const std::vector<float>& scores, int column) const {
    const auto at = static_cast<std::size_t>(column - begin);
    return column >= begin && at < scores.size() ? scores[at] : kNever;
  }
};

}  // namespace

MonotonePath best_monotone_path(const Band& band, const RowScores& similarities, const PathOptions& options) {
  const std::size_t rows = band.begin.size();
  std::vector<std::size_t> first(rows + 1);  // cell of each row
  for (std::size_t row = 0; row < rows; ++row)
    first[row + 1] = first[row] + static_cast<std::size_t>(band.end[row] - band.begin[row]);
  std::vector<std::uint8_t> from(first[rows]);
  MonotonePath best;
  std::size_t row_of_best = rows;
  int column = 0;
  Row before, now;
  std::vector<float> scores;
  for (std::size_t row = 0; row < rows; ++row) {
    now.begin = band.begin[row];
    now.on_path.clear();
    now.in_gap.clear();
    scores.resize(first[row + 1] - first[row]);
    similarities(static_cast<int>(row), band.begin[row], band.end[row], scores.data());
    for (int at = band.begin[row]; at < band.end[row]; ++at) {
      const auto cell = static_cast<std::size_t>(at - now.begin);
      const float gain = scores[cell] - options.threshold;
      std::pair<float, From> path{2 * gain, kStart}, gap{0, kStart};
      const auto offer = [](std::pair<float, From>& one, float score, From where) {
        if (score > one.first) one = {score, where};
      };
      offer(path, before.path(at - 1) + 2 * gain, kBoth);
      offer(path, before.gap(at - 1) + 2 * gain, kGap);
      offer(path, before.path(at) + gain - options.turn, kRow);
      offer(path, now.path(at - 1) + gain - options.turn, kColumn);
      offer(gap, before.gap(at), kRow);
      offer(gap, now.gap(at - 1), kColumn);
      offer(gap, path.first - options.gap, kPath);
      now.on_path.push_back(path.first);
      now.in_gap.push_back(gap.first);
      from[first[row] + cell] = static_cast<std::uint8_t>(path.second | gap.second << 4);
      if (path.first <= best.score) continue;
      best.score = path.first;
      row_of_best = row;
      column = at;
    }
    std::swap(before, now);
  }
  if (row_of_best == rows) return best;
  bool in_gap = false;
  for (std::size_t row = row_of_best;;) {
    const std::uint8_t both = from[first[row] + static_cast<std::size_t>(column - band.begin[row])];
    const int where = in_gap ? both >> 4 : both & 15;
    if (!in_gap) best.pairs.emplace_back(static_cast<int>(row), column);
    if (where == kStart) break;
    if (where == kPath) {
      in_gap = false;
      continue;
    }
    in_gap = in_gap || where == kGap;
    if (where != kColumn) --row;
    if (where != kRow) --column;
  }
  std::reverse(best.pairs.begin(), best.pairs.end());
  return best;
}

Band band_about(const MonotonePath& path, int block, int rows, int columns) {
  const int down = (rows + block - 1) / block, across = (columns + block - 1) / block;
  std::vector<int> left(static_cast<std::size_t>(down), across), right(static_cast<std::size_t>(down), -1);
  int row = 0, column = 0;
  const auto widen = [&] {
    for (int near = std::max(0, row - kMargin); near <= std::min(down - 1, row + kMargin); ++near) {
      const auto at = static_cast<std::size_t>(near);
      left[at] = std::min(left[at], std::max(0, column - kMargin));
      right[at] = std::max(right[at], std::min(across - 1, column + kMargin));
    }
  };
  const auto go_on = [&](int to_row, int to_column) {  // across a gap: down first
    for (; row < to_row; ++row) widen();
    for (; column < to_column; ++column) widen();
    widen();
  };
  for (const auto& [to_row, to_column] : path.pairs) go_on(to_row, to_column);
  go_on(down - 1, across - 1);
  Band band;
  for (int fine = 0; fine < rows; ++fine) {
    const auto at = static_cast<std::size_t>(fine / block);
    band.begin.push_back(left[at] * block);
    band.end.push_back(std::min(columns, (right[at] + 1) * block));
  }
  return band;
}

}  // namespace citylearn
