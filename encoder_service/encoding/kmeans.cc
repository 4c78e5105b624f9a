// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/kmeans.h"

#include <algorithm>

#include "core/util/random.h"

namespace citylearn {

using Eigen::Index;
using Eigen::MatrixXf;
using Eigen::VectorXf;

constexpr Index kPointsAtOnce = 512;  // points at a time, whose products stay in the processor's cache

std::vector<int> nearest(const Eigen::Ref<const MatrixXf>& points, const MatrixXf& centres) {
  std::vector<int> result(static_cast<std::size_t>(points.cols()));
  const VectorXf halves = 0.5f * centres.colwise().squaredNorm().transpose();
  MatrixXf products(centres.cols(), std::min(points.cols(), kPointsAtOnce));
  for (Index begin = 0; begin < points.cols(); begin += kPointsAtOnce) {
    const Index count = std::min(kPointsAtOnce, points.cols() - begin);
    products.leftCols(count).noalias() = centres.transpose() * points.middleCols(begin, count);
    for (Index i = 0; i < count; ++i) {
      products.col(i) -= halves;
      // The greatest first: Eigen finds it many at a time, but not its place.
      const float* values = products.col(i).data();
      const float most = products.col(i).maxCoeff();
      result[static_cast<std::size_t>(begin + i)] =
          static_cast<int>(std::find(values, values + centres.cols() - 1, most) - values);
    }
  }
  return result;
}

MatrixXf kmeans(const MatrixXf& points, int k, int iterations, std::uint64_t seed) {
  Random random{seed, 0x6B6D65616E73ull};
  MatrixXf centres(points.rows(), k);
  VectorXf distances = VectorXf::Constant(points.cols(), 1);
  for (int i = 0; i < k; ++i) {
    // A point is taken with a chance in proportion to its squared distance from the centres so far.
    double left = random.uniform() * distances.cast<double>().sum();
    Index chosen = 0;
    while (chosen + 1 < points.cols() && (left -= distances[chosen]) > 0) ++chosen;
    centres.col(i) = points.col(chosen);
    const VectorXf now = (points.colwise() - centres.col(i)).colwise().squaredNorm();
    distances = i == 0 ? now : distances.cwiseMin(now).eval();
  }
  for (int iteration = 0; iteration < iterations; ++iteration) {
    const std::vector<int> word = nearest(points, centres);
    MatrixXf sums = MatrixXf::Zero(points.rows(), k);
    VectorXf counts = VectorXf::Zero(k);
    for (Index i = 0; i < points.cols(); ++i) {
      sums.col(word[static_cast<std::size_t>(i)]) += points.col(i);
      counts[word[static_cast<std::size_t>(i)]] += 1;
    }
    for (int i = 0; i < k; ++i)  // a centre without points stays
      if (counts[i] > 0) centres.col(i) = sums.col(i) / counts[i];
  }
  return centres;
}

}  // namespace citylearn
