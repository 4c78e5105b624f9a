// SPDX-License-Identifier: Apache-2.0
#include "tools/export/picture_export.h"

#include <spdlog/spdlog.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/error.h"
#include "encoder_service/pipeline/learned_files.h"
#include "policy_service/interchange/agent_graph.h"
#include "tools/export/encoder_graph.h"

namespace citylearn {
namespace {

constexpr int kMaxSide = 4096;  // pixels

/// The task that an agent was trained on, as its run's manifest has it.
class TrainedOn {
 public:
  /// Throws Error when there is no such manifest, or none of a run with an encoder_service.
  explicit TrainedOn(const std::string& path) try : path_(path), manifest_(parse_json(read_file(path), path)) {
    const auto recipe =
        manifest_.is_object() ? FeatureRecipe::parse(traversal(first()).value("encoder", "")) : std::nullopt;
    if (!recipe)
      throw Error("names no encoder that the agent learned with", path_,
                  "export an agent of a run with an encoder_service; without --picture the agent is written alone");
    recipe_ = *recipe;
  } catch (const nlohmann::json::exception&) {
    throw Error("is not the manifest of a run", path, "name it with --manifest");
  }
  const FeatureRecipe& recipe() const { return recipe_; }
  /// Returns the name of the encoder: "patchnorm" of "patchnorm-1 height=32".
  std::string encoder() const {
    const std::string versioned = recipe_.encoder.substr(0, recipe_.encoder.find(' '));
    return versioned.substr(0, versioned.rfind('-'));
  }
  /// Returns the first traversal that it learned on.
  std::string first() const {
    const std::string all = manifest_.value("train", "");
    return all.substr(0, all.find(','));
  }
  std::uint64_t hash(const std::string& name) const {
    return std::strtoull(traversal(name).value("hash", "0").c_str(), nullptr, 16);
  }

 private:
  nlohmann::json traversal(const std::string& name) const {
    const nlohmann::json all = manifest_.value("traversals", nlohmann::json::object());
    if (!all.contains(name))
      throw Error("knows no traversal '" + name + "'", path_,
                  "name with --reference a traversal of its run, or the file with --reduction");
    return all.at(name);
  }

  std::string path_;
  nlohmann::json manifest_;
  FeatureRecipe recipe_;
};

/// Returns the manifest of the run whose checkpoint this is: checkpoints are in a folder beside it.
std::string manifest_of(const PictureExportOptions& options) {
  namespace fs = std::filesystem;
  if (!options.manifest.empty()) return options.manifest;
  std::string path = fs::absolute(options.agent.checkpoint).parent_path().parent_path() / "manifest.json";
  if (!fs::exists(path))
    throw Error("is not there", path, "it says which encoder the agent learned with; name it with --manifest");
  return path;
}

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
    path = reduction_path(options.store, encoder.name, trained.hash(reference), *wanted);
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
  const TrainedOn trained(manifest_of(options));
  PictureEncoding encoding;
  encoding.encoder = options.encoder.empty() ? trained.encoder() : options.encoder;
  const auto& entry = EncoderRegistry::instance().find("encoder", encoding.encoder);
  const auto given = options.parameters.find(entry.name);
  encoding.parameters = Parameters("encoder " + entry.name, entry.parameters,
                                   given == options.parameters.end() ? std::map<std::string, double>() : given->second);
  encoding.files = options.files;
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
