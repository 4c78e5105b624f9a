// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <string>

#include "encoder_service/onnx/onnx_backend.h"
#include "encoder_service/onnx/onnx_network.h"
#include "tests/support/networks/tiny_onnx.h"
#include "tests/support/text.h"

namespace citylearn::testing {

using Values = std::map<std::string, double>;

inline bool by_opencv() { return onnx_library().starts_with("OpenCV"); }

/// Returns the library's name of a node.
inline std::string layer_of(const std::string& node) { return (by_opencv() ? "onnx_node!" : "") + node; }

inline std::unique_ptr<Encoder> make_onnx(const EncoderFiles& files, const Values& values = {}) {
  const auto& entry = EncoderRegistry::instance().find("encoder", "onnx");
  return entry.create(Parameters("onnx", entry.parameters, values), files);
}

inline std::string refusal(const EncoderFiles& files, const Values& values = {}) {
  return error_of([&] { make_onnx(files, values); });
}

/// The picture's bytes as they are.
inline const Values kBytes = {{"scale", 255}, {"mean-red", 0},      {"mean-green", 0},      {"mean-blue", 0},
                              {"rgb", 1},     {"deviation-red", 1}, {"deviation-green", 1}, {"deviation-blue", 1}};

inline const cv::Mat kFlat(4, 4, CV_8UC3, cv::Scalar(10, 20, 30));

}  // namespace citylearn::testing
