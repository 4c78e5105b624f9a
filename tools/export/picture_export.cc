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

/// What an agent learned from, as its checkpoint says, or else the manifest of its run.
class TrainedOn {
 public:
  /// Throws Error when neither says it, or the run had no encoder_service.
  TrainedOn(const PictureExportOptions& options, const TrainingData& data)
      : path_(data.known() && options.manifest.empty() ? options.agent.checkpoint : manifest_of(options)),
        data_(path_ == options.agent.checkpoint ? data : TrainingData::parse(read_file(path_), path_)) {
    const auto recipe =
        data_.known() ? FeatureRecipe::parse(data_.traversals.front().encoder.value_or("")) : std::nullopt;
    if (!recipe)
      throw Error("names no encoder that the agent learned with", path_,
                  "export an agent of a run with an encoder_service; without --picture the agent is written alone");
    recipe_ = *recipe;
  }
  const FeatureRecipe& recipe() const { return recipe_; }
  /// Returns the first traversal that it learned on.
  std::string first() const { return data_.traversals.front().traversal; }
  /// Returns the hash of the traversal that the reduction was learned on; `name` where nothing else says which.
  std::uint64_t reference(const std::string& name) const {
    if (recipe_.learned_on != 0) return recipe_.learned_on;
    for (const TraversalContents& one : data_.traversals)
      if (one.traversal == name) return one.hash;
    throw Error("knows no traversal '" + name + "'", path_,
                "name with --reference a traversal of its run, or the file with --reduction");
  }

 private:
  /// Checkpoints are in a folder beside the manifest of their run.
  static std::string manifest_of(const PictureExportOptions& options) {
    namespace fs = std::filesystem;
    if (!options.manifest.empty()) return options.manifest;
    std::string path = fs::absolute(options.agent.checkpoint).parent_path().parent_path() / "manifest.json";
    if (!fs::exists(path))
      throw Error("is not there", path, "it says which encoder the agent learned with; name it with --manifest");
    return path;
  }

  std::string path_;
  TrainingData data_;
  FeatureRecipe recipe_;
};

Reduction find_reduction(const PictureExportOptions& options, const TrainedOn& trained, const Encoder::Spec& encoder,
                         int features) {
  const std::string& recipe = trained.recipe().reduction;
  std::string path = options.reduction_file;
  auto wanted = options_of(recipe);
  if (wanted) require_exportable(wanted->centring);
  if (path.empty()) {
    if (!wanted)
      throw Error("is needed: the agent learned with the reduction in a file '" + recipe + "'", "--reduction");
    if (wanted->dimension > 0) wanted->dimension = features;  // a short reference has fewer than the recipe says
    if (wanted->dimension == 0 && wanted->centring == Centring::kNone)
      return Reduction::learn(Eigen::MatrixXf::Zero(encoder.dimension, 1), *wanted);
    const std::string reference = options.reference.empty() ? trained.first() : options.reference;
    path = reduction_path(options.store, encoder.name, trained.reference(reference), *wanted);
    if (options.store.empty() || !std::filesystem::exists(path))
      throw Error("has no reduction (" + recipe + ") learned on '" + reference + "'",
                  options.store.empty() ? "no --store" : "store " + options.store,
                  "name the encoder_service's --store, the traversal it learned on with --reference, or the file with "
                  "--reduction");
  }
  const std::string bytes = read_file(path);
  return Reduction::load(std::as_bytes(std::span(bytes)), encoder.name, path);
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
  const TrainedOn trained(options, exported.agent.data);
  PictureEncoding encoding;
  const auto [entry, files] =
      choose_encoder(options.encoder.empty() ? trained.recipe().encoder_option() : options.encoder, options.files);
  encoding.encoder = entry.name;
  const auto given = options.parameters.find(entry.name);
  encoding.parameters = Parameters("encoder " + entry.name, entry.parameters,
                                   given == options.parameters.end() ? std::map<std::string, double>() : given->second);
  encoding.files = files;
  require_exportable(entry.name);
  const Encoder::Spec spec = entry.create(encoding.parameters, encoding.files)->spec();
  if (spec.name != trained.recipe().encoder)
    throw Error("is '" + spec.name + "', but the agent of " + options.agent.checkpoint + " learned with '" +
                    trained.recipe().encoder + "'",
                "encoder", "give the encoder_service's options");
  encoding.reduction = find_reduction(options, trained, spec, exported.agent.task.features);
  encoding.picture = options.picture;
  std::map<std::string, std::string> metadata = exported.metadata;
  metadata["encoder"] = trained.recipe().text();
  const std::string bytes = picture_agent_bytes(encoding, exported.agent, exported.parameters, metadata);
  write_file(options.agent.output, bytes);
  spdlog::info(
      "wrote {} ({} bytes): pictures of {} x {}, encoder {}, {} features, agent {}, {} frames from frame {} on",
      options.agent.output, bytes.size(), encoding.picture.width, encoding.picture.height, spec.name,
      exported.agent.task.features, exported.agent.name, exported.agent.task.frames, exported.agent.first_frame);
}

}  // namespace citylearn
