// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "encoder_service/onnx/onnx_file.h"

namespace citylearn {

/// A library that computes a network's layers. The build has one of two: ONNX Runtime where it is installed, else
/// OpenCV's DNN module.
class OnnxBackend {
 public:
  virtual ~OnnxBackend() = default;
  /// Returns the names of the layers, in the file's order.
  virtual std::vector<std::string> layers() const = 0;
  virtual bool pools(const std::string& layer) const = 0;
  /// Makes run() compute up to a layer of layers(); called once. Throws Error when the library cannot, or computes a
  /// node before it otherwise than ONNX defines.
  virtual void select(const std::string& layer) = 0;
  /// Returns how many pictures run() takes; 0: any number.
  virtual int batch() const = 0;
  /// Returns the layer's output for n x 3 x height x width numbers, valid until the next call. Throws std::exception
  /// with the library's reason.
  virtual cv::Mat run(const cv::Mat& input) = 0;
};

/// Returns the library and its version, which numbers may depend on: "OpenCV 4.6.0", "ONNX Runtime 1.21.0".
std::string onnx_library();

/// Reads a network. `file`: what read_onnx() said of it. `size`: width and height of its pictures. Throws Error naming
/// `where` when the library cannot.
std::unique_ptr<OnnxBackend> make_onnx_backend(OnnxModel model, const OnnxFile& file, std::array<int, 2> size,
                                               const std::string& where);

}  // namespace citylearn
