// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/exporters/lstm.h"

namespace citylearn {
namespace {

const AgentGraphRegistry::Registration baseline_registration{
    {"baseline", "as networks/baseline.cc", {}, [](const Parameters& parameters, const TrainedAgent& agent) {
       auto graph = std::make_unique<AgentGraph>(agent);
       const OnnxValue sensed = graph->concat({destination(graph->position(), agent.task.frames, parameters["scale"]),
                                               destination(graph->goal(), agent.task.places(), parameters["scale"])});
       export_lstm(*graph, parameters, graph->layer(sensed, "sensors.weight", "sensors.bias"));
       return graph;
     }}};

}  // namespace
}  // namespace citylearn
