#include "env_service/datasets/panorama.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace citylearn {

cv::Mat crop_panorama(const cv::Mat& panorama, const View& view) {
  constexpr double kPi = std::numbers::pi;
  // Where the panorama has more pixels than the view, it is drawn larger and reduced by area: no aliasing.
  const int larger = std::clamp(static_cast<int>(std::lround(panorama.cols * view.field / 360 / view.size)), 1, 4);
  const int size = view.size * larger;
  const double focal = size / 2.0 / std::tan(view.field / 2 * kPi / 180);
  cv::Mat columns(size, size, CV_32F), rows(size, size, CV_32F);
  for (int v = 0; v < size; ++v)
    for (int u = 0; u < size; ++u) {
      const double x = (u + 0.5 - size / 2.0) / focal, y = (v + 0.5 - size / 2.0) / focal;
      const double turn = (view.heading / 360 + std::atan(x) / (2 * kPi) + 0.5) * panorama.cols - 0.5;
      const double fall = (std::atan2(y, std::hypot(x, 1)) / kPi + 0.5) * panorama.rows - 0.5;
      columns.at<float>(v, u) = static_cast<float>(turn - std::floor(turn / panorama.cols) * panorama.cols);
      rows.at<float>(v, u) = static_cast<float>(fall);
    }
  cv::Mat drawn, reduced;
  cv::remap(panorama, drawn, columns, rows, cv::INTER_LINEAR, cv::BORDER_WRAP);
  if (larger == 1) return drawn;
  cv::resize(drawn, reduced, cv::Size(view.size, view.size), 0, 0, cv::INTER_AREA);
  return reduced;
}

}  // namespace citylearn
