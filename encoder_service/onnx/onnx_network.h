// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "encoder_service/encoding/encoder.h"

namespace citylearn {

/// Parameters of preprocessing, the same for every encoder that runs a network.
std::vector<ParameterSpec> network_parameters();
/// "imagenet, netvlad, ...", for messages and help.
std::string list_presets();

/// A convolutional network read from an ONNX file and run by OpenCV's DNN module on the processor, from a picture to
/// the output of one layer. Pictures are run one by one whatever the model's batch: so the numbers never depend on what
/// else is encoded, and nothing is lost (docs/how-to/use-an-onnx-encoder.md). Used by one thread at a time.
class OnnxNetwork {
 public:
  /// Throws Error: no such file, no ONNX model, an operator that OpenCV cannot import (named), no such layer (names
  /// some), an unknown preset, parameters that contradict the model's input shape, a network that fails on a picture.
  OnnxNetwork(const Parameters& parameters, const EncoderFiles& files);
  ~OnnxNetwork();

  /// Layer's output for an 8-bit BGR picture of any size: 32-bit floats of shape(), whose first side is 1. Valid until
  /// the next call. Throws Error when a number is not finite.
  cv::Mat forward(const cv::Mat& picture);
  /// The input alone (1 x 3 x height x width) and the network alone; forward() is one after the other.
  const cv::Mat& prepare(const cv::Mat& picture);
  cv::Mat run(const cv::Mat& input);

  const std::vector<int>& shape() const { return shape_; }
  int width() const { return width_; }
  int height() const { return height_; }
  /// For Encoder::Spec::name: hash of the model, layer, and everything that is done to a picture before.
  std::string description() const;
  const std::string& model() const { return path_; }
  /// As OpenCV calls it.
  const std::string& layer() const { return layer_; }

 private:
  void choose_layer(const std::string& wanted, bool pooled);
  void choose_size(const std::vector<std::int64_t>& shape, int width, int height, bool firm);

  struct Parts;
  std::unique_ptr<Parts> parts_;  // OpenCV's objects
  std::string path_, hash_, layer_;
  int width_ = 0, height_ = 0;
  bool rgb_ = true;
  float scale_ = 1;
  std::array<float, 3> mean_{}, deviation_{};      // red, green, blue
  std::array<std::array<float, 256>, 3> table_{};  // what each value of a byte becomes, by channel of the input
  std::vector<int> shape_;
};

/// `name`, or its beginning and a hash when it has more than the 200 characters of Encoder::Spec::name.
std::string fit_name(const std::string& name);

}  // namespace citylearn
