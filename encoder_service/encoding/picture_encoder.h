// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <span>
#include <string>

#include "encoder_service/encoding/encoder.h"

namespace citylearn {

/// An encoder that encodes each picture by itself.
class PictureEncoder : public Encoder {
 public:
  /// Throws Error when a picture is not 8-bit with 3 channels, OpenCV fails, or a descriptor is not finite.
  Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) final;

 protected:
  /// Fills `descriptor` (D numbers, zeros when called). May throw cv::Exception.
  virtual void describe(const cv::Mat& picture, Eigen::Ref<Eigen::VectorXf> descriptor) = 0;
};

/// Throws Error when the picture is empty or not 8-bit with 3 channels.
void check_picture(const cv::Mat& picture);

/// Returns the Spec::name of an encoder, "hog-1 bins=12 contrast=1 ...", with all parameters in alphabetical order.
std::string encoder_name(const std::string& name_and_version, const Parameters& parameters);

/// Resizes `picture` (8-bit or float, any channels): by means over areas where it shrinks (so nothing aliases), by
/// cubic interpolation where it grows.
cv::Mat scaled(const cv::Mat& picture, int width, int height);

/// Returns the grey values 0..255 in floating point (ITU-R BT.601) of a BGR picture, scaled.
cv::Mat scaled_grey(const cv::Mat& picture, int width, int height);

/// Returns (g - mean) / sqrt(variance + 16) of each channel (float, 0..255) under a Gaussian window of `sigma` pixels,
/// which removes slow changes of light and of contrast.
cv::Mat sliding_normalised(const cv::Mat& picture, double sigma);

/// Of the encoder raw84: pixels of a side, and deviations from black to white where contrast is normalised.
inline constexpr int kRaw84Side = 84;
inline constexpr double kRaw84Deviations = 6;

}  // namespace citylearn
