// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <span>
#include <string>

#include "encoder_service/encoding/encoder.h"

namespace citylearn {

/// An encoder that looks at one picture at a time.
class PictureEncoder : public Encoder {
 public:
  /// Throws Error: a picture that is not 8-bit with 3 channels, a fault inside OpenCV, a descriptor that is not finite.
  Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) final;

 protected:
  /// Fills `descriptor` (D numbers, zeros when called). May throw cv::Exception.
  virtual void describe(const cv::Mat& picture, Eigen::Ref<Eigen::VectorXf> descriptor) = 0;
};

/// Throws Error when the picture is empty or not 8-bit with 3 channels.
void check_picture(const cv::Mat& picture);

/// Spec::name of an encoder: "hog-1 bins=12 contrast=1 ...", all parameters in alphabetical order.
std::string encoder_name(const std::string& name_and_version, const Parameters& parameters);

/// `picture` (8-bit or float, any channels) at another size: means over areas where it shrinks (so nothing aliases),
/// cubic interpolation where it grows.
cv::Mat scaled(const cv::Mat& picture, int width, int height);

/// Grey values 0..255 in floating point (ITU-R BT.601) of a BGR picture, scaled.
cv::Mat scaled_grey(const cv::Mat& picture, int width, int height);

/// (g - mean) / sqrt(variance + 16) of a grey picture (0..255) under a Gaussian window of `sigma` pixels: what is left
/// when slow changes of light and of contrast are taken away.
cv::Mat sliding_normalised(const cv::Mat& grey, double sigma);

}  // namespace citylearn
