// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/interchange/onnx_graph.h"

namespace citylearn {

/// Pictures within a graph: batch x channels x height x width, floats.
struct OnnxPicture {
  OnnxValue value;
  int channels = 0, width = 0, height = 0;
};

/// Multiplies each row of pixels by `across` (new width x width) and each column by `down` (new height x height). All
/// resizing and smoothing that OpenCV does is of this form, with weights that both readers of the file then share.
OnnxPicture transformed(const OnnxPicture& picture, const Matrix<float>& across, const Matrix<float>& down);
/// Resizes with weights of OpenCV's; `interpolation` is cv::INTER_AREA and the like.
OnnxPicture resized(const OnnxPicture& picture, int width, int height, int interpolation);
/// Combines the channels of each pixel: weights (new channels x channels) and a bias each.
OnnxPicture recoloured(const OnnxPicture& picture, const Matrix<float>& weights, const std::vector<float>& bias);
/// Rounds to whole numbers, halves upwards.
OnnxPicture rounded(const OnnxPicture& picture);
/// Limits each number to 0 .. most.
OnnxPicture limited(const OnnxPicture& picture, float most);

/// Appends what scaled() of the encoders computes. With `bytes` pixels are bytes, which are rounded after each step.
OnnxPicture scaled(const OnnxPicture& picture, int width, int height, bool bytes);
/// Appends what scaled_grey() of the encoders computes, for a picture in red, green, blue.
OnnxPicture scaled_grey(const OnnxPicture& picture, int width, int height);
/// Appends what sliding_normalised() of the encoders computes.
OnnxPicture sliding_normalised(const OnnxPicture& picture, double sigma);
/// batch x (channels * height * width), row by row; the channels of a pixel together, or channel after channel.
OnnxValue flattened(const OnnxPicture& picture, bool channels_last);

}  // namespace citylearn
