// SPDX-License-Identifier: Apache-2.0
#include "policy_service/results/pairing.h"

#include <algorithm>
#include <cstdlib>
#include <utility>
#include <vector>

namespace citylearn {
namespace {

constexpr int kMostPlaces = 512;     // more cost their square in memory, and tell the same
constexpr int kFewestPlaces = 16;    // fewer tell nothing
constexpr int kFewestApart = 3;      // less does no harm
constexpr float kClearGain = 0.75F;  // of a path over chance, compared with what chance gains over the pairs

/// A counterpart of each row, the counterparts in order.
struct Path {
  std::vector<int> columns;
  float similarity = 0;  ///< mean
};

/// Returns the path of greatest similarity whose columns never decrease.
Path best_path(const Matrix<float>& similarity) {
  const std::ptrdiff_t rows = similarity.rows(), columns = similarity.cols();
  Matrix<float> sum(rows, columns);  // of the best path up to this row that ends in this column
  Matrix<int> from(rows, columns);   // its column in the row before
  for (std::ptrdiff_t row = 0; row < rows; ++row) {
    std::ptrdiff_t best = 0;
    for (std::ptrdiff_t column = 0; column < columns; ++column) {
      if (row > 0 && sum(row - 1, column) > sum(row - 1, best)) best = column;
      from(row, column) = static_cast<int>(best);
      sum(row, column) = similarity(row, column) + (row > 0 ? sum(row - 1, best) : 0);
    }
  }
  Path path{std::vector<int>(static_cast<std::size_t>(rows))};
  std::ptrdiff_t column;
  path.similarity = sum.row(rows - 1).maxCoeff(&column) / static_cast<float>(rows);
  for (std::ptrdiff_t row = rows; row-- > 0; column = from(row, column))
    path.columns[static_cast<std::size_t>(row)] = static_cast<int>(column);
  return path;
}

/// Returns the features without what all have in common, as the light, at unit length.
Matrix<float> directions(const Matrix<float>& features) {
  return (features.colwise() - features.rowwise().mean().eval()).colwise().normalized();
}

}  // namespace

int places_apart(const Matrix<float>& taught, const Matrix<float>& walked) {
  const std::ptrdiff_t shared = std::min(taught.cols(), walked.cols());
  const std::ptrdiff_t step = (shared + kMostPlaces - 1) / kMostPlaces;
  const auto places = static_cast<int>(step > 0 ? shared / step : 0);
  if (places < kFewestPlaces || taught.rows() != walked.rows()) return 0;
  const auto some = Eigen::seqN(0, places, step);
  const Matrix<float> similarity =
      directions(taught(Eigen::all, some)).transpose() * directions(walked(Eigen::all, some));
  const float pairs = similarity.diagonal().mean();
  Path best = best_path(similarity), other = best_path(similarity.rowwise().reverse());
  const bool backwards = other.similarity > best.similarity;
  if (backwards) std::swap(best, other);
  // A path finds something to follow in any two recordings. How much shows the one that goes the other way.
  if (pairs >= other.similarity || best.similarity - other.similarity < kClearGain * (other.similarity - pairs))
    return 0;
  std::vector<int> apart;
  for (int place = 0; place < places; ++place) {
    const int column = best.columns[static_cast<std::size_t>(place)];
    apart.push_back(std::abs((backwards ? places - 1 - column : column) - place));
  }
  std::nth_element(apart.begin(), apart.begin() + places / 2, apart.end());
  const int median = apart[static_cast<std::size_t>(places / 2)];
  return median >= kFewestApart ? median * static_cast<int>(step) : 0;
}

}  // namespace citylearn
