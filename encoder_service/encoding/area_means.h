// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

namespace citylearn {

/// Scales `grey` (8-bit, one channel) down to floating point: each pixel is the mean of those in its area, as by
/// cv::resize with INTER_AREA, which is several times slower where the sides are not multiples. `size`: at most that of
/// `grey`.
cv::Mat area_means(const cv::Mat& grey, cv::Size size);

}  // namespace citylearn
