// SPDX-License-Identifier: Apache-2.0
#include "env_service/images/panorama.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace citylearn {

cv::Mat crop_panorama(const cv::Mat& panorama, const View& view) {
  constexpr double kPi = std::numbers::pi;
  // Where the panorama has more pixels than the view, it is drawn larger and reduced by area: no aliasing.
  const int larger = std::clamp(static_cast<int>(std::lround(panorama.cols * view.field / 360 / view.size)), 1, 4);
  const int size = view.size * larger;
  const double focal = size / 2.0 / std::tan(view.field / 2 * kPi / 180);
  // A view's column is a meridian of the panorama: one row of `columns` does for all.
  cv::Mat meridians(1, size, CV_32F), columns, rows(size, size, CV_32F);
  std::vector<double> reach(static_cast<std::size_t>(size));  // from the camera to the view's column, at the horizon
  for (int u = 0; u < size; ++u) {
    const double x = (u + 0.5 - size / 2.0) / focal;
    const double turn = (view.heading / 360 + std::atan(x) / (2 * kPi) + 0.5) * panorama.cols - 0.5;
    meridians.at<float>(0, u) = static_cast<float>(turn - std::floor(turn / panorama.cols) * panorama.cols);
    reach[static_cast<std::size_t>(u)] = std::hypot(x, 1);
  }
  cv::repeat(meridians, size, 1, columns);
  for (int v = 0; v < size; ++v) {
    const double y = (v + 0.5 - size / 2.0) / focal;
    float* row = rows.ptr<float>(v);
    for (int u = 0; u < size; ++u)
      row[u] =
          static_cast<float>((std::atan(y / reach[static_cast<std::size_t>(u)]) / kPi + 0.5) * panorama.rows - 0.5);
  }
  cv::Mat drawn, reduced;
  cv::remap(panorama, drawn, columns, rows, cv::INTER_LINEAR, cv::BORDER_WRAP);
  if (larger == 1) return drawn;
  cv::resize(drawn, reduced, cv::Size(view.size, view.size), 0, 0, cv::INTER_AREA);
  return reduced;
}

}  // namespace citylearn
