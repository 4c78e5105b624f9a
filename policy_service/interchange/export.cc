// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/export.h"

#include <spdlog/spdlog.h>

#include <filesystem>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/util/sha256.h"
#include "policy_service/interchange/agent_graph.h"
#include "policy_service/interchange/safetensors.h"
#include "policy_service/network/checkpoint.h"

namespace citylearn {

std::string onnx_bytes(const TrainedAgent& agent, const Parameters& parameters,
                       const std::map<std::string, std::string>& metadata) {
  return export_graph(agent, parameters)
      ->bytes(
          "One step of a navigation agent. Give next_state back as state; the action is drawn from softmax(logits).",
          metadata);
}

ExportedAgent read_exported_agent(const ExportOptions& options) {
  if (options.checkpoint.empty()) throw Error("is needed", "--checkpoint", "the file to export");
  const Checkpoint checkpoint = read_checkpoint(options.checkpoint);
  ExportedAgent exported;
  TrainedAgent& agent = exported.agent = trained_agent(checkpoint);
  const auto& entry = NetworkRegistry<float>::instance().find("network", agent.name);
  const auto& given = checkpoint.header.at("network");
  exported.parameters = Parameters("network " + agent.name, entry.parameters, agent.network_parameters);
  exported.metadata = {{"agent", agent.name},
                       {"frames", std::to_string(agent.task.frames)},
                       {"first_frame", std::to_string(agent.first_frame)},
                       {"features", std::to_string(agent.task.features)},
                       {"network", given.dump()},
                       {"checkpoint_sha256", sha256(read_file(options.checkpoint))}};
  if (agent.places > 0) exported.metadata["places"] = std::to_string(agent.places);
  if (agent.data.known()) exported.metadata["data"] = agent.data.text();
  if (!options.parameters.empty()) {
    load_parameters(options.parameters, agent);
    exported.metadata["parameters_sha256"] = sha256(read_file(options.parameters));
  }
  return exported;
}

void export_agent(const ExportOptions& options) {
  const std::string format = std::filesystem::path(options.output).extension();
  if (format != ".onnx" && format != ".safetensors")
    throw Error("'" + options.output + "' says no format", "--output", "name a file FILE.onnx or FILE.safetensors");
  const ExportedAgent exported = read_exported_agent(options);
  const TrainedAgent& agent = exported.agent;
  const std::string bytes = format == ".onnx" ? onnx_bytes(agent, exported.parameters, exported.metadata)
                                              : parameters_of(agent, exported.metadata).bytes();
  write_file(options.output, bytes);
  spdlog::info("wrote {} ({} bytes): agent {}, {} features, {} frames from frame {} on, update {}", options.output,
               bytes.size(), agent.name, agent.task.features, agent.task.frames, agent.first_frame, agent.update);
}

}  // namespace citylearn
