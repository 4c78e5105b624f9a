// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "env_service/images/images.h"

namespace citylearn {

/// Numbers of a descriptor that describe one eighth of the picture's width, from left to right.
inline constexpr int kDescriptorColumn = 4 * 8;

/// Returns histograms of gradients of pictures reduced to 64 x 32: D x N, of 8 x 4 cells, 8 orientations each. They
/// hardly change with light and season. A picture that cannot be decoded has zeros. Throws
/// Error when the process is told to stop.
Eigen::MatrixXf describe_pictures(Images& images, const std::vector<int>& frames);

}  // namespace citylearn
