// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

namespace citylearn {

/// A perspective view of an equirectangular panorama.
struct View {
  double heading = 0;  ///< degrees to the right of the panorama's middle column; any number
  double field = 90;   ///< degrees that the view's width and height span, below 180
  int size = 224;      ///< pixels, width and height
};

/// Returns the view as a pinhole camera without distortion sees it, level with the horizon. `panorama` spans 360
/// degrees by 180, 8-bit, 1 or 3 channels.
cv::Mat crop_panorama(const cv::Mat& panorama, const View& view);

}  // namespace citylearn
