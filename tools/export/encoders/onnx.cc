// SPDX-License-Identifier: Apache-2.0
#include <opencv2/imgproc.hpp>

#include "core/files/files.h"
#include "encoder_service/onnx/onnx_network.h"
#include "tools/export/encoder_graph.h"

namespace citylearn {
namespace {

/// Returns a layer's name as the model has it: OpenCV puts its own word before the names of ONNX nodes.
std::string node_name(const std::string& layer) {
  const std::size_t mark = layer.find('!');
  return layer.starts_with("onnx_node") && mark != layer.npos ? layer.substr(mark + 1) : layer;
}

/// Appends what encoders/onnx.cc computes.
std::unique_ptr<EncoderGraph> append_onnx(const Parameters& parameters, const EncoderFiles& files,
                                          const OnnxPicture& picture) {
  const OnnxNetwork network(parameters, files);
  OnnxPicture input = picture;
  int interpolation = cv::INTER_LINEAR;
  for (const auto& [width, height] :
       resizing_steps({picture.width, picture.height}, {network.width(), network.height()})) {
    if (width != input.width || height != input.height) input = rounded(resized(input, width, height, interpolation));
    interpolation = cv::INTER_AREA;
  }
  Matrix<float> weights = Matrix<float>::Zero(3, 3);
  std::vector<float> bias(3);
  for (int colour = 0; colour < 3; ++colour) {
    const int channel = network.rgb() ? colour : 2 - colour;
    const auto c = static_cast<std::size_t>(colour);
    weights(channel, colour) = network.scale() / 255 / network.deviation()[c];
    bias[static_cast<std::size_t>(channel)] = -network.mean()[c] / network.deviation()[c];
  }
  OnnxGraph& graph = *picture.value.graph;
  OnnxValue output = graph.append_network(read_file(files.model), recoloured(input, weights, bias).value,
                                          node_name(network.layer()), files.model);
  const std::vector<int>& shape = network.shape();
  std::int64_t numbers = 1;
  for (const int side : shape) numbers *= side;
  if (shape.size() == 4 && parameters.flag("pool")) {
    output = graph.node("GlobalAveragePool", {output});
    numbers = shape[1];
  }
  return std::make_unique<EncoderGraph>(graph.node("Reshape", {output, graph.integers({-1, numbers})}));
}

const EncoderGraphRegistry::Registration onnx_registration{{"onnx", "as encoders/onnx.cc", {}, append_onnx}};

}  // namespace
}  // namespace citylearn
