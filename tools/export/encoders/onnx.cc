// SPDX-License-Identifier: Apache-2.0
#include <opencv2/imgproc.hpp>

#include "encoder_service/onnx/onnx_file.h"
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
  const std::vector<std::byte> model = load_onnx(files.model).bytes;
  OnnxValue output =
      graph.append_network(std::string(reinterpret_cast<const char*>(model.data()), model.size()),
                           recoloured(input, weights, bias).value, node_name(network.layer()), files.model);
  const std::vector<int>& shape = network.shape();
  std::int64_t numbers = 1;
  for (const int side : shape) numbers *= side;
  if (const int pool = parameters.integer("pool"); shape.size() == 4 && pool > 0) {
    output = pool == 1 ? graph.node("GlobalAveragePool", {output})
                       : transformed({output, shape[1], shape[3], shape[2]}, cell_means(shape[3], pool),
                                     cell_means(shape[2], pool))
                             .value;
    numbers = std::int64_t{shape[1]} * pool * pool;
  }
  return std::make_unique<EncoderGraph>(graph.node("Reshape", {output, graph.integers({-1, numbers})}));
}

const EncoderGraphRegistry::Registration onnx_registration{{"onnx", "as encoders/onnx.cc", {}, append_onnx}};

}  // namespace
}  // namespace citylearn
