// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/exporters/lstm.h"

namespace citylearn {
namespace {

const AgentGraphRegistry::Registration features_registration{
    {"features", "as networks/features.cc", {}, [](const Parameters& parameters, const TrainedAgent& agent) {
       auto graph = std::make_unique<AgentGraph>(agent);
       const OnnxValue sensed =
           graph->concat({static_cast<float>(parameters["scale"]) * graph->features(),
                          destination(graph->goal(), agent.task.places(), parameters["goal-scale"])});
       export_lstm(*graph, parameters, graph->layer(sensed, "sensors.weight", "sensors.bias"));
       return graph;
     }}};

}  // namespace
}  // namespace citylearn
