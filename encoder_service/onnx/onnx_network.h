// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "encoder_service/encoding/encoder.h"

namespace citylearn {

/// Returns the parameters of preprocessing, the same for every encoder that runs a network.
std::vector<ParameterSpec> network_parameters();
/// Returns "imagenet, netvlad, ..." for messages and help.
std::string list_presets();

/// A network read from an ONNX file, from a picture to the output of one layer, computed on the processor by ONNX
/// Runtime or by OpenCV (onnx_backend.h). Used by one thread at a time.
class OnnxNetwork {
 public:
  /// Throws Error when the file is missing or not an ONNX model, the library cannot import an operator or computes it
  /// otherwise than ONNX defines (named), the layer or preset is unknown, parameters contradict the model's input
  /// shape, or the network fails on a picture.
  OnnxNetwork(const Parameters& parameters, const EncoderFiles& files);
  ~OnnxNetwork();

  /// Gives `take` the index and the layer's output of each 8-bit BGR picture, of any size, in turn: 32-bit floats of
  /// shape(), whose first side is 1. Pictures run in batches where the library and the model can. Throws Error when a
  /// number is not finite.
  void forward(std::span<const cv::Mat> pictures, const std::function<void(std::size_t, std::span<const float>)>& take);
  /// Prepares the input (n x 3 x height x width; n as the model wants, the last picture repeated), and runs the network
  /// on it; forward() does both.
  const cv::Mat& prepare(std::span<const cv::Mat> pictures);
  cv::Mat run(const cv::Mat& input);

  /// Returns how many pictures run at once.
  int batch() const { return batch_; }
  /// Returns, for Encoder::Spec::batch, how many pictures one forward() takes best.
  int pictures_a_call() const { return batch_ > 1 ? batch_ : 4; }
  const std::vector<int>& shape() const { return shape_; }
  int width() const { return width_; }
  int height() const { return height_; }
  /// Returns, for Encoder::Spec::name, the hash of the model, the layer, all preprocessing, and
  /// the library but for OpenCV 4.6, whose names had none when there was no other.
  std::string description() const;
  const std::string& model() const { return path_; }

 private:
  void choose_layer(const std::string& wanted, bool pooled);
  void choose_size(const std::vector<std::int64_t>& shape, int width, int height, bool firm);

  struct Impl;
  std::unique_ptr<Impl> impl_;  // the library's objects
  std::string path_, hash_, layer_;
  int width_ = 0, height_ = 0, batch_ = 1;
  bool rgb_ = true;
  float scale_ = 1;
  std::array<float, 3> mean_{}, deviation_{};      // red, green, blue
  std::array<std::array<float, 256>, 3> table_{};  // what each value of a byte becomes, by channel of the input
  std::vector<int> shape_;
  std::size_t numbers_ = 0;  // of one picture
};

/// Returns the weights (cells x side) by which a side of a feature map is averaged over cells. Cell i goes from
/// i side / cells, rounded down, to (i + 1) side / cells, rounded up, as in PyTorch's adaptive_avg_pool2d.
Eigen::MatrixXf cell_means(int side, int cells);

/// Returns `name`, or its beginning and a hash when it is longer than the 200 characters of Encoder::Spec::name.
std::string fit_name(const std::string& name);

}  // namespace citylearn
