// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace citylearn {

/// Returns for each column of `points` (D x n) the nearest column of `centres` (D x k; the first of equals).
std::vector<int> nearest(const Eigen::Ref<const Eigen::MatrixXf>& points, const Eigen::MatrixXf& centres);

/// Finds k centres (D x k) of `points` (D x n, n >= 1) by Lloyd's algorithm from k-means++ starts (Arthur &
/// Vassilvitskii, SODA 2007). The same seed gives the same centres. With fewer different points than k some centres are
/// equal.
Eigen::MatrixXf kmeans(const Eigen::MatrixXf& points, int k, int iterations, std::uint64_t seed);

}  // namespace citylearn
