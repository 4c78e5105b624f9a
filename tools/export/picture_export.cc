// SPDX-License-Identifier: Apache-2.0
#include "tools/export/picture_export.h"

#include <spdlog/spdlog.h>

#include <cstdio>
#include <filesystem>

#include "core/files/files.h"
#include "core/util/error.h"
#include "encoder_service/encoder_options.h"
#include "encoder_service/pipeline/learned_files.h"
#include "policy_service/interchange/agent_graph.h"
#include "tools/export/encoder_graph.h"

namespace citylearn {
namespace {

constexpr int kMaxSide = 4096;  // pixels

/// Returns how the features were made that an agent learned with. Throws Error when its checkpoint does not say it.
FeatureRecipe recipe_of_agent(const TrainedAgent& agent, const std::string& checkpoint) {
  const auto& traversals = agent.data.traversals;
  const auto recipe = traversals.empty() ? std::nullopt : FeatureRecipe::parse(traversals[0].encoder.value_or(""));
  if (!recipe)
    throw Error("names no encoder that the agent learned with", checkpoint,
                "its run had no encoder_service, or is of version 0.1; without --picture the agent is written alone");
  return *recipe;
}

/// Returns the reduction of descriptors of `dimension` numbers to `features`.
Reduction find_reduction(const PictureExportOptions& options, const FeatureRecipe& recipe, int dimension,
                         int features) {
  std::string path = options.reduction_file;
  auto wanted = options_of(recipe.reduction);
  if (wanted) require_exportable(wanted->centring);
  if (path.empty()) {
    if (!wanted)
      throw Error("is needed: the agent learned with the reduction in a file '" + recipe.reduction + "'",
                  "--reduction");
    if (wanted->dimension > 0) wanted->dimension = features;  // a short reference has fewer than the recipe says
    if (wanted->dimension == 0 && wanted->centring == Centring::kNone)
      return Reduction::learn(Eigen::MatrixXf::Zero(dimension, 1), *wanted);
    path = reduction_path(options.store, recipe.encoder, recipe.learned_on, *wanted);
    if (options.store.empty() || !std::filesystem::exists(path))
      throw Error("has no reduction of '" + recipe.text() + "'",
                  options.store.empty() ? "no --store" : "store " + options.store,
                  "name the encoder_service's --store, or the file with --reduction");
  }
  const std::string bytes = read_file(path);
  return Reduction::load(std::as_bytes(std::span(bytes)), recipe.encoder, path);
}

}  // namespace

PictureSize picture_size(const std::string& text) {
  PictureSize size;
  int read = 0;
  if (std::sscanf(text.c_str(), "%dx%d%n", &size.width, &size.height, &read) != 2 ||
      read != static_cast<int>(text.size()) || size.width < 1 || size.height < 1 || size.width > kMaxSide ||
      size.height > kMaxSide)
    throw Error("'" + text + "' is not a size of 1x1 to 4096x4096 pixels", "--picture", "write 160x96");
  return size;
}

std::string picture_agent_bytes(const PictureEncoding& encoding, const TrainedAgent& agent,
                                const Parameters& network_parameters,
                                const std::map<std::string, std::string>& metadata) {
  const std::unique_ptr<AgentGraph> agent_graph = export_graph(agent, network_parameters);
  if (!agent_graph->has_input("features"))
    throw Error("does not look at pictures", "agent '" + agent.name + "'", "export it without --picture");
  if (encoding.reduction.dimension() != agent.task.features)
    throw Error("gives " + std::to_string(encoding.reduction.dimension()) + " features, the agent takes " +
                    std::to_string(agent.task.features),
                "the reduction", "take the one that the agent learned with");
  OnnxGraph graph("picture_" + agent.name);
  const PictureSize& size = encoding.picture;
  const OnnxValue pixels = graph.input("picture", std::vector<std::int64_t>{3, size.height, size.width},
                                       "red, green, blue; whole numbers 0 .. 255");
  const OnnxValue descriptor =
      append_encoder({pixels, 3, size.width, size.height}, encoding.encoder, encoding.parameters, encoding.files);
  const OnnxValue features = append_reduction(descriptor, encoding.reduction);
  const std::int64_t width = agent.task.features;
  graph.output("features", features, width, "of the picture: what the agent sees");
  std::map<std::string, OnnxValue> given = {{"features", features}};
  if (agent_graph->has_input("condition")) {
    const OnnxValue condition = counted(
        graph.input("condition", width + 1, "next_condition of the step before; zeros: a traversal never seen before"),
        features);
    graph.output("next_condition", condition, width + 1, "to be given as condition with the next step");
    given["condition"] = condition;
  }
  graph.append(*agent_graph, given);
  const OnnxValue likeliest = graph.node("ArgMax", {{&graph, "logits"}}, {{"axis", std::int64_t{1}}});
  graph.output("action", graph.node("Cast", {likeliest}, {{"to", std::int64_t{1}}}), 1,
               "the likeliest: 0 stay, 1 next, 2 previous");
  graph.close_batch();
  return graph.bytes("One step of a navigation agent, from a picture. Give each next_X back as X.", metadata);
}

void export_picture_agent(const PictureExportOptions& options) {
  if (std::filesystem::path(options.agent.output).extension() != ".onnx")
    throw Error("'" + options.agent.output + "' is not a file FILE.onnx", "--output");
  const ExportedAgent exported = read_exported_agent(options.agent);
  const FeatureRecipe recipe = recipe_of_agent(exported.agent, options.agent.checkpoint);
  PictureEncoding encoding;
  const auto [entry, files] =
      choose_encoder(options.encoder.empty() ? recipe.encoder_option() : options.encoder, options.files);
  encoding.encoder = entry.name;
  const auto given = options.parameters.find(entry.name);
  encoding.parameters = Parameters("encoder " + entry.name, entry.parameters,
                                   given == options.parameters.end() ? std::map<std::string, double>() : given->second);
  encoding.files = files;
  require_exportable(entry.name);
  const Encoder::Spec spec = entry.create(encoding.parameters, encoding.files)->spec();
  if (spec.name != recipe.encoder)
    throw Error("is '" + spec.name + "', but the agent of " + options.agent.checkpoint + " learned with '" +
                    recipe.encoder + "'",
                "encoder", "give the encoder_service's options");
  encoding.reduction = find_reduction(options, recipe, spec.dimension, exported.agent.task.features);
  encoding.picture = options.picture;
  std::map<std::string, std::string> metadata = exported.metadata;
  metadata["encoder"] = recipe.text();
  const std::string bytes = picture_agent_bytes(encoding, exported.agent, exported.parameters, metadata);
  write_file(options.agent.output, bytes);
  spdlog::info(
      "wrote {} ({} bytes): pictures of {} x {}, encoder {}, {} features, agent {}, {} frames from frame {} on",
      options.agent.output, bytes.size(), encoding.picture.width, encoding.picture.height, spec.name,
      exported.agent.task.features, exported.agent.name, exported.agent.task.frames, exported.agent.first_frame);
}

}  // namespace citylearn
