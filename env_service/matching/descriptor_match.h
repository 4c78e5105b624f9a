// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

namespace citylearn {

/// Which frames of two recordings of a route show the same places, by what they look like.
struct DescriptorMatch {
  std::vector<std::pair<int, int>> pairs;  ///< (frame of one, frame of the other), neither ever decreasing
  std::vector<float> confidence;  ///< of each pair, 0: as similar as chance would have it; 1: as pairs are on average
  bool clear = false;             ///< the pairs are much more similar than in a recording that was driven the other way
};

/// Matches columns: D x N and D x M descriptors of one kind, N and M at most 40,000. Finds stops, any speed, and parts
/// that only one of them has. `column` numbers of a descriptor belong to one of the equal columns of its picture, so
/// that a camera may look a little to the side; 0: they belong to none. Needs memory of N + M, not of N x M.
DescriptorMatch match_descriptors(const Eigen::MatrixXf& one, const Eigen::MatrixXf& other, int column);

}  // namespace citylearn
