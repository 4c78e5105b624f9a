// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/sliding_normalisation.h"

#include <opencv2/imgproc.hpp>
#include <vector>

#include "encoder_service/encoding/gradients.h"

namespace citylearn {
namespace {

using Eigen::Index;
using Eigen::MatrixXf;

/// Returns the matrix that blurs a column of `size` pixels as cv::GaussianBlur does.
MatrixXf gaussian_windows(int size, double sigma) {
  const int reach = (cvRound(8 * sigma + 1) | 1) / 2;
  const cv::Mat kernel = cv::getGaussianKernel(2 * reach + 1, sigma, CV_32F);
  MatrixXf windows = MatrixXf::Zero(size, size);
  for (int pixel = 0; pixel < size; ++pixel)
    for (int i = -reach; i <= reach; ++i)
      windows(pixel, cv::borderInterpolate(pixel + i, size, cv::BORDER_REFLECT_101)) += kernel.at<float>(reach + i);
  return windows;
}

}  // namespace

SlidingNormalisation::SlidingNormalisation(cv::Size size, double sigma)
    : down_(gaussian_windows(size.height, sigma)), across_(gaussian_windows(size.width, sigma).transpose()) {}

cv::Mat SlidingNormalisation::apply(const cv::Mat& picture) const {
  CV_Assert(picture.depth() == CV_32F && picture.rows == down_.rows() && picture.cols == across_.cols());
  std::vector<cv::Mat> planes;
  cv::split(picture, planes);
  const Index height = down_.rows(), width = across_.cols();
  RowMajorXf values(height, width), squares(height, width), rows(height, width), mean(height, width),
      mean_square(height, width);
  for (cv::Mat& plane : planes) {
    Eigen::Map<RowMajorXf> pixels(plane.ptr<float>(), height, width);
    // Variance as mean of squares minus square of mean loses few digits when the values are taken about a middle.
    values = pixels.array() - 128;
    squares = values.cwiseAbs2();
    rows.noalias() = values * across_;
    mean.noalias() = down_ * rows;
    rows.noalias() = squares * across_;
    mean_square.noalias() = down_ * rows;
    pixels = (values - mean).array() / ((mean_square - mean.cwiseAbs2()).cwiseMax(0.f).array() + 16).sqrt();
  }
  cv::Mat result;
  cv::merge(planes, result);
  return result;
}

}  // namespace citylearn
