// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>

#include "core/plugin/plugins.h"
#include "core/wire/service.h"
#include "encoder_service/encoder_options.h"
#include "encoder_service/pipeline/learned_files.h"
#include "policy_service/interchange/onnx_graph.h"
#include "tools/export/picture_export.h"

namespace {

using namespace citylearn;

void add_options(CLI::App& app, PictureExportOptions& options, std::string& picture) {
  app.add_option("--checkpoint", options.agent.checkpoint, "Checkpoint of the agent")->type_name("FILE")->required();
  app.add_option("--parameters", options.agent.parameters,
                 "Safetensors file whose parameters replace those of --checkpoint")
      ->type_name("FILE");
  app.add_option("--output", options.agent.output,
                 "File to write: FILE.onnx (opset " + std::to_string(OnnxGraph::kOpset) +
                     ", open batch) or, of the parameters alone, FILE.safetensors")
      ->type_name("FILE")
      ->required();

  const std::string encoding = "Encoder and reduction, with --picture";
  app.option_defaults()->group(encoding);
  app.add_option("--picture", picture,
                 "Write FILE.onnx from a picture to an action. Width and height of the pictures: 160x96, as recorded")
      ->type_name("SIZE");
  app.add_option("--encoder", options.encoder,
                 "Encoder that the agent learned with; by default as the checkpoint says");
  add_encoder_options(app, options.files, options.parameters, encoding);
  app.add_option("--reduction", options.reduction_file, "File of the reduction; by default found in --store")
      ->type_name("FILE");
  app.add_option("--store", options.store, "Store of the encoder_service that the agent learned with")
      ->type_name("DIR")
      ->envname("CITYLEARN_STORE")
      ->capture_default_str();
}

}  // namespace

int main(int argc, char** argv) {
  PictureExportOptions options;
  std::string picture;
  options.store = default_store();
  return service_main(
      argc, argv, "Writes an agent as an ONNX file, with its encoder or alone, or its parameters.",
      [&](CLI::App& app) {
        add_plugin_option(app, argc, argv);
        add_options(app, options, picture);
      },
      [&] {
        if (picture.empty()) {
          export_agent(options.agent);
          return 0;
        }
        if (options.store == "none") options.store.clear();
        options.picture = picture_size(picture);
        export_picture_agent(options);
        return 0;
      });
}
