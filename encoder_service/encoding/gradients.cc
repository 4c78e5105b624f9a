// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/gradients.h"

#include <algorithm>

namespace citylearn {

Gradients gradients_of(const cv::Mat& grey) {
  CV_Assert(grey.type() == CV_32F && grey.cols > 1);
  cv::Mat dx(grey.size(), CV_32F), dy(grey.size(), CV_32F);
  const int last = grey.cols - 1;
  for (int y = 0; y < grey.rows; ++y) {
    const float* row = grey.ptr<float>(y);
    const float* above = grey.ptr<float>(std::max(y - 1, 0));
    const float* below = grey.ptr<float>(std::min(y + 1, grey.rows - 1));
    float* across = dx.ptr<float>(y);
    float* down = dy.ptr<float>(y);
    for (int x = 1; x < last; ++x) across[x] = row[x + 1] - row[x - 1];
    across[0] = row[1] - row[0];
    across[last] = row[last] - row[last - 1];
    for (int x = 0; x <= last; ++x) down[x] = below[x] - above[x];
  }
  Gradients result;
  cv::cartToPolar(dx, dy, result.magnitude, result.angle);
  return result;
}

}  // namespace citylearn
