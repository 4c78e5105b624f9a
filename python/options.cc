// SPDX-License-Identifier: Apache-2.0
#include "python/options.h"

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
#include "policy_service/run/run_options.h"
#include "python/errors.h"
#include "tools/lab/descriptors.h"

namespace citylearn::python {
namespace {

constexpr std::uint64_t kUnlimitedSteps = 1'000'000'000'000;  // steps, the most that a trainer takes

const std::string kGroup = "Options";  // one without a name hides options' names in messages

struct RecordingOptions {
  Source source;
  Imperfections imperfections;
  std::string encoder = kDefaultEncoder, store = default_store();
  EncoderFiles files;
  std::map<std::string, std::map<std::string, double>> encoder_parameters;
  ReductionChoice reduction;
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
      throw UnknownOption("unknown option '" + name + "'", "", "known: " + joined(known));
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
  add_selection_options(app, options.source.selection, kGroup);
  add_imperfection_options(app, options.imperfections, kGroup);
  app.add_option("--encoder", options.encoder);
  add_encoder_options(app, options.files, options.encoder_parameters, kGroup);
  app.add_option("--store", options.store)->envname("CITYLEARN_STORE");
  add_reduction_options(app, options.reduction, kGroup);
}

/// Returns the traversal that --reference names. An Error names the option, which may have been left out.
Traversal reference_traversal(Dataset& dataset, const std::string& name, const Selection& selection) try {
  return select(dataset, name, selection);
} catch (const Error& error) {
  throw Error(error.what(), "--reference '" + name + "'");
}

/// Turns pictures into features as an encoder_service with these options does.
Traversal encoded(const Traversal& pictures, Dataset& dataset, RecordingOptions& options) {
  const auto& entry = EncoderRegistry::instance().find("encoder", options.encoder);
  const auto encoder = entry.create(
      Parameters("encoder " + entry.name, entry.parameters, options.encoder_parameters[entry.name]), options.files);
  const std::string store = options.store == "none" ? "" : options.store;
  const ReductionChoice& choice = options.reduction;
  ReductionOptions how = reduction_for(options.encoder, choice);
  if (how.keeps_all() && encoder->training_sample_count() == 0)
    return lab::with_features(pictures, lab::encode(*encoder, pictures, entry.name, store).matrix);
  Selection selection = options.source.selection;
  selection.align.clear();
  const bool own = choice.reference == pictures.name;
  const Traversal reference = own ? pictures : reference_traversal(dataset, choice.reference, selection);
  if (!reference.images) throw Error("has no pictures to learn from", "reference '" + choice.reference + "'");
  std::vector<cv::Mat> sample;
  for (const int frame : training_frames(encoder->training_sample_count(), reference.frames))
    sample.push_back(lab::read_picture(reference, frame));
  if (!sample.empty()) encoder->learn(sample);
  const Eigen::MatrixXf descriptors = lab::encode(*encoder, reference, entry.name, store).matrix;
  if (!choice.dimension_given)
    how.dimension = std::min(how.dimension, Reduction::largest_dimension(descriptors.rows(), descriptors.cols()));
  const Reduction reduction = Reduction::learn(descriptors, how);
  return lab::with_features(
      pictures, reduction.apply(own ? descriptors : lab::encode(*encoder, pictures, entry.name, store).matrix));
}

}  // namespace

Recording load_recording(const Keywords& keywords) {
  CLI::App app;
  RecordingOptions options;
  add_recording_options(app, options);
  parse(app, keywords);
  const std::unique_ptr<Dataset> dataset = open_dataset(options.source);
  Recording recording{imperfect(select(*dataset, chosen_traversal(*dataset, options.source), options.source.selection),
                                options.imperfections),
                      options.imperfections};
  Traversal& traversal = recording.traversal;
  traversal.name = name_from(traversal.name);
  if (!traversal.turns.empty())
    throw Error("crosses itself, which agents cannot be told yet", "traversal '" + traversal.name + "'",
                "leave its turns empty");
  for (const char* option : {"--encoder", "--reference", "--dimension"})
    if (!traversal.images && app.count(option) > 0)
      throw Error("is for pictures, but traversal '" + traversal.name + "' has features", option, "leave it out");
  if (traversal.images) traversal = encoded(traversal, *dataset, options);
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

PolicyServiceOptions read_learner_options(const Keywords& keywords) {
  PolicyServiceOptions options;
  options.node.service = "policy_service";
  options.node.id = "policy";  // the service's own default, so that each may resume the other's run
  options.role = "learner";
  options.learner = "python";
  options.threads = 1;  // the actors act, and Python learns
  options.wait = 30;
  CLI::App app;
  app.add_option("--agent", options.agent);
  app.add_option("--seed", options.seed);
  app.add_option("--output", options.output);
  app.add_flag("--resume", options.resume);
  app.add_flag("--overwrite", options.overwrite);
  app.add_option("--initial", options.initial_checkpoint);
  add_task_options(app, options);
  add_learner_options(app, options);
  add_length_options(app, options);
  add_node_options(app, options.node);
  add_metrics_option(app, options.node);
  const auto agent = keywords.find("agent");
  const auto& network =
      NetworkRegistry<float>::instance().find("agent", agent == keywords.end() ? options.agent : agent->second);
  add_parameters(app, network.name, network.parameters, options.network_parameters);
  add_parameters(app, "trainer", Trainer::parameter_specs(), options.trainer_parameters);
  parse(app, keywords);
  if (options.steps == 0 && !options.trainer_parameters.contains("steps")) options.steps = kUnlimitedSteps;
  options.configuration = option_values(app, 0, nullptr);
  return checked_options(options);
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
