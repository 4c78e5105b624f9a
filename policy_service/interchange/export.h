// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "policy_service/network/checkpoint/trained_agent.h"

namespace citylearn {

struct ExportOptions {
  std::string checkpoint;  ///< file of the agent
  std::string parameters;  ///< safetensors file whose parameters replace the checkpoint's; none when empty
  std::string output;      ///< file to write: NAME.onnx or NAME.safetensors
};

/// Writes the agent in the format that the output's name asks for (docs/reference/export-formats.md). The same inputs
/// give the same bytes. Throws Error naming the option or file.
void export_agent(const ExportOptions& options);

/// Returns the agent as an ONNX file's bytes, with `metadata`.
std::string onnx_bytes(const TrainedAgent& agent, const Parameters& parameters,
                       const std::map<std::string, std::string>& metadata);

}  // namespace citylearn
