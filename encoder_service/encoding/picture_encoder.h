// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <opencv2/core.hpp>
#include <span>
#include <string>

#include "encoder_service/encoding/encoder.h"

namespace citylearn {

/// An encoder that encodes each picture by itself, several at once on OpenCV's threads (cv::setNumThreads).
class PictureEncoder : public Encoder {
 public:
  /// Throws Error when a picture is not 8-bit with 3 channels, OpenCV fails, or a descriptor is not finite.
  Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) final;

 protected:
  /// Returns Spec::batch: pictures that keep all threads busy.
  static int batch();
  /// Fills `descriptor` (D numbers, zeros when called). May throw cv::Exception. Several threads may call it at once.
  virtual void describe(const cv::Mat& picture, Eigen::Ref<Eigen::VectorXf> descriptor) const = 0;
};

/// Runs `work` for 0..count - 1, shared between OpenCV's threads. What it throws is thrown here.
void for_each_on_threads(int count, const std::function<void(int)>& work);

/// Throws Error when the picture is empty or not 8-bit with 3 channels.
void check_picture(const cv::Mat& picture);

/// Returns the Spec::name of an encoder, "hog-1 bins=12 contrast=1 ...", with all parameters in alphabetical order.
std::string encoder_name(const std::string& name_and_version, const Parameters& parameters);

/// Resizes `picture` (8-bit or float, any channels): by means over areas where it shrinks (so nothing aliases), by
/// cubic interpolation where it grows.
cv::Mat scaled(const cv::Mat& picture, int width, int height);

/// Returns the grey values 0..255 in floating point (ITU-R BT.601) of a BGR picture, scaled.
cv::Mat scaled_grey(const cv::Mat& picture, int width, int height);

}  // namespace citylearn
