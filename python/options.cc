// SPDX-License-Identifier: Apache-2.0
#include "python/options.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <opencv2/core.hpp>

#include "core/command_line/number_check.h"
#include "core/util/name.h"
#include "core/wire/service.h"
#include "encoder_service/encoder_options.h"
#include "encoder_service/pipeline/learned_files.h"
#include "env_service/dataset_io/selection.h"
#include "env_service/traversal/goal_place.h"
#include "python/errors.h"
#include "tools/lab/descriptors.h"

namespace citylearn::python {
namespace {

const std::string kGroup = "Options";  // one without a name hides options' names in messages

struct RecordingOptions {
  Source source;
  Imperfections imperfections;
  int goals = 1;
  std::string encoder = kDefaultEncoder, store = default_store();
  EncoderFiles files;
  std::map<std::string, std::map<std::string, double>> encoder_parameters;
  ReductionChoice reduction;
  bool selection_given = false, reduction_given = false;
};

std::string with(std::string name, char from, char to) {
  std::replace(name.begin(), name.end(), from, to);
  return name;
}

std::vector<std::string> names_of(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options())
    if (option != app.get_help_ptr() && !option->get_lnames().empty())
      names.push_back(with(option->get_lnames().front(), '-', '_'));
  std::sort(names.begin(), names.end());
  return names;
}

void parse(CLI::App& app, const Keywords& keywords) {
  const std::vector<std::string> known = names_of(app);
  std::vector<std::string> arguments;
  for (const auto& [name, value] : keywords) {
    if (!std::binary_search(known.begin(), known.end(), name))
      throw UnknownOption("unexpected keyword argument '" + name + "'", "", "known: " + joined(known));
    arguments.push_back("--" + with(name, '_', '-') + "=" + value);
  }
  check_numbers(app);
  try {
    app.parse(arguments);
  } catch (const CLI::ParseError& error) {
    throw Error(error.what());
  }
}

void add_recording_options(CLI::App& app, RecordingOptions& options) {
  add_source_options(app, options.source, kGroup);
  add_goal_option(app, options.source);
  add_goals_option(app, options.goals);
  add_selection_options(app, options.source.selection, kGroup);
  add_imperfection_options(app, options.imperfections, kGroup);
  app.add_option("--encoder", options.encoder);
  add_encoder_options(app, options.files, options.encoder_parameters, kGroup);
  app.add_option("--store", options.store)->envname("CITYLEARN_STORE");
  add_reduction_options(app, options.reduction, kGroup);
}

RecordingOptions read_recording_options(const Keywords& keywords) {
  CLI::App app;
  RecordingOptions options;
  add_recording_options(app, options);
  parse(app, keywords);
  const auto any = [&](const std::vector<std::string>& names) {
    return std::any_of(names.begin(), names.end(), [&](const std::string& name) { return keywords.contains(name); });
  };
  options.selection_given = any({"frames", "metres", "step", "step_metres"});
  options.reduction_given = any({"dimension", "whitening", "centring"});
  return options;
}

/// Returns whether services announce a recording as `name`, in whatever world.
bool announced(const std::string& recording, const std::string& name) {
  return name == name_from(recording) || without_goal(name) == name_in_world(recording, world_of(name));
}

/// Returns the options given, and those of the training for what they leave out.
Keywords with_training(const Keywords& given, const TrainingData& learned) {
  if (!learned.known()) return given;
  const TraversalContents& first = learned.traversals.front();
  Keywords all;
  for (const auto& [name, value] : learned.source) all[with(name, '-', '_')] = value;
  const bool elsewhere = given.contains("data") || given.contains("dataset");
  const std::string dataset = all.emplace("dataset", first.dataset).first->second;
  if (!elsewhere && !all.contains("data") && dataset != "synthetic")
    throw Error("are not known", "the recordings of the training", "give --data, or train with --source");
  // Another folder or dataset has parameters of its own.
  const auto other = given.find("dataset");
  if (elsewhere && (other == given.end() ? dataset == "synthetic" : other->second != dataset))
    std::erase_if(all, [&](const auto& one) { return one.first == "dataset" || one.first.starts_with(dataset + "_"); });
  if (const auto recipe = FeatureRecipe::parse(first.encoder.value_or(""))) {
    all.emplace("encoder", recipe->encoder_option());
    all.emplace("reference", first.traversal);
  }
  // A checkpoint must not choose which program runs: the caller of evaluate() names it.
  const auto named = all.find("encoder");
  if (named != all.end() && (named->second == "python" || named->second.ends_with(".py"))) {
    named->second = "python";
    all.erase("model");
  }
  for (const auto& [name, value] : given) all[name] = value;
  if (!all.contains("condition")) all.emplace("traversal", first.traversal);
  if (const auto found = all.find("align_to"); found != all.end() && announced(found->second, all["traversal"]))
    for (const char* name : {"align_to", "align_by", "align_within"}) all.erase(name);
  return all;
}

/// Returns the name in its dataset of a recording that services announce as `name`, or of several that were joined, if
/// there are such.
std::optional<std::string> find_name(Dataset& dataset, const std::string& name) {
  const std::vector<std::string> names = dataset.names();
  if (std::find(names.begin(), names.end(), name) != names.end()) return name;
  const auto found = std::find_if(names.begin(), names.end(), [&](const auto& one) { return announced(one, name); });
  if (found != names.end()) return *found;
  for (const std::string& first : names)
    if (const std::string begin = name_from(first + "+"); name.starts_with(begin))
      if (const auto rest = find_name(dataset, name.substr(begin.size()))) return first + "+" + *rest;
  return std::nullopt;
}
std::string name_in(Dataset& dataset, const std::string& name) { return find_name(dataset, name).value_or(name); }

/// Selects the first frames, if it is these that the agent learned from.
void select_as_taught(Dataset& dataset, Selection& selection, const TraversalContents& taught) {
  const auto name = find_name(dataset, taught.traversal);
  if (!name || taught.frames < 2 || dataset.on_streets()) return;  // streets are taken as a whole
  Selection first = selection;
  first.align.clear();
  first.end = static_cast<int>(taught.frames);
  const Traversal whole = dataset.load(*name);
  if (!whole.streets && whole.frames > first.end && select(dataset, *name, first).hash() == taught.hash)
    selection.end = first.end;
}

/// Returns the traversal that --reference names. An Error names the option, which may have been left out.
Traversal reference_traversal(Dataset& dataset, const RecordingOptions& options) try {
  Selection selection = options.source.selection;
  selection.align.clear();
  return select(dataset, name_in(dataset, options.reduction.reference), selection);
} catch (const Error& error) {
  throw Error(error.what(), "--reference '" + options.reduction.reference + "'");
}

/// Returns the traversal that the encoder of an agent learned from: it is here, or where the training found it.
Traversal taught_reference(const RecordingOptions& options, const TrainingData& learned, std::uint64_t hash) {
  std::vector<RecordingOptions> tried = {options};
  if (!learned.source.empty()) tried.push_back(read_recording_options(with_training({}, learned)));
  std::string why;
  for (RecordingOptions& one : tried) try {
      const std::unique_ptr<Dataset> dataset = open_dataset(one.source);
      if (!one.selection_given) select_as_taught(*dataset, one.source.selection, learned.traversals.front());
      Traversal found = reference_traversal(*dataset, one);
      if (found.hash() == hash) return found;
      why = fmt::format("'{}' has other contents (hash {:016x})", found.name, found.hash());
    } catch (const Error& error) {
      why = error.what();
    }
  throw Error(fmt::format("is not here, {:016x}: {}", hash, why), "the recording that the encoder learned from",
              learned.remedy(options.reduction.reference));
}

/// Turns pictures into features as an encoder_service with these options does, or did in the training. Returns what it
/// would announce as TraversalInfo.encoder.
std::string encode(Traversal& pictures, Dataset& dataset, RecordingOptions& options, const TrainingData& learned) {
  const auto [entry, files] = choose_encoder(options.encoder, options.files);
  const auto encoder = entry.create(
      Parameters("encoder " + entry.name, entry.parameters, options.encoder_parameters[entry.name]), files);
  const std::string store = options.store == "none" ? "" : options.store;
  const auto taught =
      learned.known() ? FeatureRecipe::parse(learned.traversals.front().encoder.value_or("")) : std::nullopt;
  ReductionOptions how = reduction_for(entry.name, options.reduction);
  if (const auto before = taught ? options_of(taught->reduction) : std::nullopt; before && !options.reduction_given)
    how = *before;
  FeatureRecipe recipe{.encoder = "", .reduction = recipe_of(how)};
  Reduction reduction;
  Eigen::MatrixXf descriptors;
  if (how.learns() || encoder->training_sample_count() > 0) {
    const bool own = taught && taught->learned_on ? pictures.hash() == taught->learned_on
                                                  : options.reduction.reference == pictures.name;
    const Traversal reference = own                            ? pictures
                                : taught && taught->learned_on ? taught_reference(options, learned, taught->learned_on)
                                                               : reference_traversal(dataset, options);
    if (!reference.images)
      throw Error("has no pictures to learn from", "reference '" + options.reduction.reference + "'");
    lab::fit_encoder(*encoder, reference);
    if (how.learns()) {
      recipe.learned_on = reference.hash();
      descriptors = lab::encode(*encoder, reference, entry.name, store).matrix;
      if (!options.reduction.dimension_given)
        how.dimension = std::min(how.dimension, Reduction::largest_dimension(descriptors.rows(), descriptors.cols()));
      reduction = Reduction::learn(descriptors, how);
    }
    if (!own) descriptors.resize(0, 0);
  }
  recipe.encoder = encoder->spec().name;
  if (descriptors.size() == 0 && how.learns() && how.centring != Centring::kOwn) {
    lab::Encoding encoding(*encoder, pictures, entry.name, store);
    pictures = lab::with_features(pictures, reduction.apply(pictures.frames, [&](Eigen::Index first, auto block) {
      encoding.read(first, block);
    }));
    return recipe.text();
  }
  if (descriptors.size() == 0) descriptors = lab::encode(*encoder, pictures, entry.name, store).matrix;
  if (!how.learns()) reduction = Reduction::learn(descriptors, how);
  pictures = lab::with_features(pictures, reduction.apply(descriptors));
  return recipe.text();
}

}  // namespace

Recording load_recording(const Keywords& keywords, const TrainingData& learned) {
  RecordingOptions options = read_recording_options(with_training(keywords, learned));
  const std::unique_ptr<Dataset> dataset = open_dataset(options.source);
  // Other recordings may lack the one that those of the training were aligned to.
  if (std::string& sibling = options.source.selection.align; !keywords.contains("align_to") && !sibling.empty())
    sibling = find_name(*dataset, sibling).value_or("");
  if (learned.known() && !options.selection_given)
    select_as_taught(*dataset, options.source.selection, learned.traversals.front());
  const std::string name = name_in(*dataset, chosen_traversal(*dataset, options.source));
  Traversal recorded =
      with_goals(with_goal(select(*dataset, name, options.source.selection), options.source.goal), options.goals);
  Recording recording{imperfect(std::move(recorded), options.imperfections), options.imperfections, options.goals, {}};
  Traversal& traversal = recording.traversal;
  traversal.name = name_from(traversal.name);
  for (const std::string option : {"encoder", "reference", "dimension"})
    if (!traversal.images && keywords.contains(option))
      throw Error("is for pictures, but traversal '" + traversal.name + "' has features", "--" + option,
                  "leave it out");
  TraversalContents contents{
      traversal.name, traversal.hash(), 0, "", traversal.dataset, static_cast<std::uint32_t>(traversal.frames)};
  if (traversal.streets) contents.streets_hash = traversal.streets->hash();
  recording.images = traversal.images;
  if (traversal.images) contents.encoder = encode(traversal, *dataset, options, learned);
  contents.feature_dimension = static_cast<std::uint32_t>(traversal.dimension);
  if (const std::string wrong = learned.misfit(contents); !wrong.empty())
    throw Error(wrong, "traversal '" + traversal.name + "'", learned.remedy(traversal.name));
  return recording;
}

NodeOptions read_node_options(const Keywords& keywords) {
  CLI::App app;
  NodeOptions options;
  options.service = "policy_service";
  static std::atomic<int> made = 0;  // several may work in one session
  options.id = "python-" + std::to_string(getpid()) + "-" + std::to_string(++made);
  add_node_options(app, options);
  parse(app, keywords);
  return options;
}

std::vector<std::string> recording_options() {
  CLI::App app;
  RecordingOptions options;
  add_recording_options(app, options);
  return names_of(app);
}

std::vector<std::string> node_option_names() {
  CLI::App app;
  NodeOptions options;
  add_node_options(app, options);
  return names_of(app);
}

}  // namespace citylearn::python
