// SPDX-License-Identifier: Apache-2.0
#include "policy_service/results/pairing.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>
#include <vector>

namespace citylearn {
namespace {

constexpr int kMostPlaces = 512;     // more cost their square in memory, and tell the same
constexpr int kFewestPlaces = 16;    // fewer tell nothing
constexpr int kFewestApart = 3;      // less does no harm
constexpr float kClearGain = 0.75F;  // of a path over chance, compared with what chance gains over the pairs
// Summer and fall of Nordland, by the standard deviations that a line's similarity lies above that of most lines: over
// 100 places the right line 6.5 to 16.7, the best of all through another part of the route up to 4.8.
constexpr float kRightLine = 6, kNoLine = 5, kNoPairs = 2.5F;
constexpr int kFewestUnlike = 48;  // places: with fewer a right line may lie as low
constexpr float kSpeeds[] = {0.5F, 0.67F, 0.8F, 1, 1.25F, 1.5F, 2};

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

/// A drive at one speed: the counterpart of row r lies at shift + speed * r, or that of the last row but r.
struct Line {
  bool backwards = false;
  float speed = 1;
  int shift = 0;         ///< of the middle row's counterpart
  float similarity = 0;  ///< mean

  int column(int row, int places) const {
    const float middle = 0.5F * static_cast<float>(places);
    const auto place = static_cast<float>(backwards ? places - 1 - row : row);
    return static_cast<int>(std::floor((place - middle) * speed + middle + 0.5F)) + shift;
  }
};

/// Returns all lines that pair at least half of the places.
std::vector<Line> lines_through(const Matrix<float>& similarity) {
  const auto places = static_cast<int>(similarity.rows());
  std::vector<Line> lines;
  for (const bool backwards : {false, true})
    for (const float speed : kSpeeds)
      for (int shift = -places / 2; shift <= places / 2; ++shift) {
        Line line{backwards, speed, shift};
        int pairs = 0;
        for (int row = 0; row < places; ++row)
          if (const int column = line.column(row, places); column >= 0 && column < places) {
            line.similarity += similarity(row, column);
            ++pairs;
          }
        if (2 * pairs < places) continue;
        line.similarity /= static_cast<float>(pairs);
        lines.push_back(line);
      }
  return lines;
}

template <class Number>
Number median(std::vector<Number> numbers) {
  const auto middle = numbers.begin() + static_cast<std::ptrdiff_t>(numbers.size() / 2);
  std::nth_element(numbers.begin(), middle, numbers.end());
  return *middle;
}

/// Returns the features without what all have in common, as the light, at unit length.
Matrix<float> directions(const Matrix<float>& features) {
  return (features.colwise() - features.rowwise().mean().eval()).colwise().normalized();
}

/// Returns how far apart pairs are by the monotone path, 0 where it is not clearly more similar than they are.
int apart_by_path(const Matrix<float>& similarity, float pairs) {
  const auto places = static_cast<int>(similarity.rows());
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
  return median(apart);
}

}  // namespace

Pairing examine_pairs(const Matrix<float>& taught, const Matrix<float>& walked) {
  const std::ptrdiff_t shared = std::min(taught.cols(), walked.cols());
  const std::ptrdiff_t step = (shared + kMostPlaces - 1) / kMostPlaces;
  const auto places = static_cast<int>(step > 0 ? shared / step : 0);
  if (places < kFewestPlaces || taught.rows() != walked.rows()) return {};
  const auto some = Eigen::seqN(0, places, step);
  const Matrix<float> similarity =
      directions(taught(Eigen::all, some)).transpose() * directions(walked(Eigen::all, some));
  const float pairs = similarity.diagonal().mean();

  const std::vector<Line> lines = lines_through(similarity);
  std::vector<float> similarities, deviations;
  for (const Line& line : lines) similarities.push_back(line.similarity);
  const float usual = median(similarities);
  for (const float one : similarities) deviations.push_back(std::abs(one - usual));
  const float deviation = 1.4826F * median(deviations);  // as a standard deviation, were it a normal distribution
  if (!(deviation > 0)) return {};
  const Line& best = *std::max_element(lines.begin(), lines.end(),
                                       [](const Line& a, const Line& b) { return a.similarity < b.similarity; });
  int apart = 0;
  if (best.similarity - usual >= kRightLine * deviation && best.similarity - pairs > 0.5F * (best.similarity - usual)) {
    std::vector<int> distances;
    for (int row = 0; row < places; ++row)
      if (const int column = best.column(row, places); column >= 0 && column < places)
        distances.push_back(std::abs(column - row));
    apart = median(distances);
  } else {
    apart = apart_by_path(similarity, pairs);
  }
  if (apart >= kFewestApart) return {.apart = apart * static_cast<int>(step)};
  return {.unlike = places >= kFewestUnlike && best.similarity - usual < kNoLine * deviation &&
                    pairs - usual < kNoPairs * deviation};
}

}  // namespace citylearn
