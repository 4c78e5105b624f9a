// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/export.h"

#include <spdlog/spdlog.h>

#include <filesystem>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/util/sha256.h"
#include "policy_service/interchange/agent_graph.h"
#include "policy_service/interchange/safetensors.h"
#include "policy_service/network/checkpoint/checkpoint.h"

namespace citylearn {

std::string onnx_bytes(const TrainedAgent& agent, const Parameters& parameters,
                       const std::map<std::string, std::string>& metadata) {
  return export_graph(agent, parameters)
      ->bytes(
          "One step of a navigation agent. Give next_state back as state; the action is drawn from softmax(logits).",
          metadata);
}

void export_agent(const ExportOptions& options) {
  const std::string format = std::filesystem::path(options.output).extension();
  if (format != ".onnx" && format != ".safetensors")
    throw Error("'" + options.output + "' says no format", "--output", "name a file FILE.onnx or FILE.safetensors");
  if (options.checkpoint.empty()) throw Error("is needed", "--checkpoint", "the file to export");
  const Checkpoint checkpoint = read_checkpoint(options.checkpoint);
  TrainedAgent agent = trained_agent(checkpoint);
  std::map<std::string, std::string> metadata = {{"agent", agent.name},
                                                 {"frames", std::to_string(agent.task.frames)},
                                                 {"first_frame", std::to_string(agent.first_frame)},
                                                 {"features", std::to_string(agent.task.features)},
                                                 {"network", checkpoint.header.at("network").dump()},
                                                 {"checkpoint_sha256", sha256(read_file(options.checkpoint))}};
  if (agent.places > 0) metadata["places"] = std::to_string(agent.places);
  if (agent.data.known()) metadata["data"] = agent.data.text();
  if (!options.parameters.empty()) {
    load_parameters(options.parameters, agent);
    metadata["parameters_sha256"] = sha256(read_file(options.parameters));
  }
  const auto& entry = NetworkRegistry<float>::instance().find("network", agent.name);
  const Parameters parameters("network " + agent.name, entry.parameters, agent.network_parameters);
  const std::string bytes =
      format == ".onnx" ? onnx_bytes(agent, parameters, metadata) : parameters_of(agent, metadata).bytes();
  write_file(options.output, bytes);
  spdlog::info("wrote {} ({} bytes): agent {}, {} features, {} frames from frame {} on, update {}", options.output,
               bytes.size(), agent.name, agent.task.features, agent.task.frames, agent.first_frame, agent.update);
}

}  // namespace citylearn
