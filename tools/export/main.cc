// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>

#include "core/plugin/plugins.h"
#include "core/wire/service.h"
#include "policy_service/interchange/export.h"
#include "policy_service/interchange/onnx_graph.h"

int main(int argc, char** argv) {
  using namespace citylearn;
  ExportOptions options;
  return service_main(
      argc, argv, "Writes an agent as an ONNX file, or its parameters.",
      [&](CLI::App& app) {
        add_plugin_option(app, argc, argv);
        app.add_option("--checkpoint", options.checkpoint, "Checkpoint of the agent")->type_name("FILE")->required();
        app.add_option("--parameters", options.parameters,
                       "Safetensors file whose parameters replace those of --checkpoint")
            ->type_name("FILE");
        app.add_option("--output", options.output,
                       "File to write: FILE.onnx (opset " + std::to_string(OnnxGraph::kOpset) +
                           ", open batch) or, of the parameters alone, FILE.safetensors")
            ->type_name("FILE")
            ->required();
      },
      [&] {
        export_agent(options);
        return 0;
      });
}
