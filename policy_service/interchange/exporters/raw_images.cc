// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/exporters/lstm.h"

namespace citylearn {
namespace {

/// A convolution over a batch of pictures, channels first. The network keeps each map's weights row by row, the
/// channels of a pixel together.
OnnxValue convolve(AgentGraph& graph, const OnnxValue& pictures, const std::string& name, std::int64_t channels,
                   std::int64_t kernel, std::int64_t stride) {
  const auto weight = graph.tensor(name + ".weight"), bias = graph.tensor(name + ".bias");
  const std::int64_t maps = weight.rows();
  std::vector<float> numbers;
  for (std::int64_t map = 0; map < maps; ++map)
    for (std::int64_t channel = 0; channel < channels; ++channel)
      for (std::int64_t pixel = 0; pixel < kernel * kernel; ++pixel)
        numbers.push_back(weight(map, pixel * channels + channel));
  return relu(graph.node("Conv",
                         {pictures, graph.constant(name + ".weight", {maps, channels, kernel, kernel}, numbers),
                          graph.constant(name + ".bias", {maps}, {bias.data(), bias.data() + bias.size()})},
                         {{"kernel_shape", std::vector{kernel, kernel}}, {"strides", std::vector{stride, stride}}}));
}

/// Exports network/agents/raw_images.cc. A picture's features are its pixels row by row, a pixel's channels together.
std::unique_ptr<AgentGraph> export_raw_images(const Parameters& parameters, const TrainedAgent& agent) {
  auto graph = std::make_unique<AgentGraph>(agent);
  const std::int64_t side = parameters.integer("side"), maps = parameters.integer("maps");
  OnnxValue seen = static_cast<float>(parameters["scale"]) * (graph->features() + -0.5f);
  seen = graph->node("Reshape", {seen, graph->integers({0, side, side, 3})});
  seen = graph->node("Transpose", {seen}, {{"perm", std::vector<std::int64_t>{0, 3, 1, 2}}});
  seen = convolve(*graph, seen, "convolution.1", 3, 8, 4);
  seen = convolve(*graph, seen, "convolution.2", maps, 4, 2);
  seen = graph->node("Transpose", {seen}, {{"perm", std::vector<std::int64_t>{0, 2, 3, 1}}});
  const std::int64_t numbers = graph->tensor("sensors.weight").cols() - 1;
  seen = graph->node("Reshape", {seen, graph->integers({0, numbers})});
  const OnnxValue sensed =
      graph->concat({seen, destination(graph->goal(), agent.task.places(), parameters["goal-scale"])});
  export_lstm(*graph, parameters, graph->layer(sensed, "sensors.weight", "sensors.bias"));
  return graph;
}

const AgentGraphRegistry::Registration raw_images_registration{
    {"raw_images", "as networks/raw_images.cc", {}, export_raw_images}};

}  // namespace
}  // namespace citylearn
