// SPDX-License-Identifier: Apache-2.0
// Command-line options of selection.h.
#include <CLI/CLI.hpp>

#include "core/command_line/range_option.h"
#include "core/task/goal_chain.h"
#include "core/util/text.h"
#include "core/wire/service.h"
#include "env_service/dataset_io/selection.h"
#include "env_service/files/files.h"
#include "env_service/traversal/goal_place.h"

namespace citylearn {
namespace {

const std::map<std::string, StateRule> kRules{{"line", StateRule::kLine},
                                              {"street", StateRule::kStreet},
                                              {"street-fixed", StateRule::kStreetFixed},
                                              {"streetlearn", StateRule::kStreetLearn}};

}  // namespace

void add_dataset_options(CLI::App& app, Source& source, const std::string& group) {
  const OptionGroup options(app, group);
  const std::string names = joined(DatasetRegistry::instance().entries(), &DatasetRegistry::Entry::name);
  const auto* dataset =
      app.add_option("--dataset", source.dataset,
                     "Dataset that traversals come from: " + names + "; with --data what the folder is recognised as")
          ->capture_default_str();
  add_dataset_parameters(app, source);
  app.add_option_function<std::string>(
         "--data",
         [&source, dataset](const std::string& folder) {
           source.folder = folder;
           if (dataset->empty()) source.dataset = dataset_of(source);
         },
         "Folder of the dataset's files")
      ->type_name("DIR");
  app.add_option_function<std::string>(
         "--rule", [&source](const std::string& name) { source.rule = kRules.at(name); },
         "How agents walk: line: along the frames; street: along the links of a map, or where a recording drove, "
         "facing one; street-fixed: with 16 headings; streetlearn: likewise, ahead to the nearest place. By default "
         "street where frames fit a map")
      ->check(CLI::IsMember(&kRules));
}

std::string dataset_of(const Source& source) {
  for (const auto& [name, given] : source.parameters)
    if (!given.empty()) return name;
  const std::vector<std::string> found = recognised(source.folder);
  return found.empty() ? "plain" : found.front();
}

void add_source_options(CLI::App& app, Source& source, const std::string& group) {
  const OptionGroup options(app, group);
  add_dataset_options(app, source, group);
  CLI::Option* traversal = app.add_option("--traversal", source.traversal,
                                          "Traversal to host; NAME-left, NAME-right: NAME as a camera further left or "
                                          "right would have seen it, unless there is one called so; A+B: recordings "
                                          "that meet, as one map of streets (with --rule street)")
                               ->capture_default_str();
  app.add_option("--condition", source.condition, "Host the one traversal recorded under this condition")
      ->excludes(traversal);
}

void add_goal_option(CLI::App& app, Source& source) {
  app.add_option("--goal-place", source.goal,
                 "Place to which all tasks lead: its number, the file of a picture, or LAT,LON or LAT,LON,METRES: the "
                 "nearest to a position, at most 50 m or so many away. Else goals are drawn")
      ->type_name("GOAL");
}

void add_goals_option(CLI::App& app, int& goals) {
  app.add_option("--goals", goals,
                 "Goals of a task, reached one after the other as by a courier: --goal-place first, then drawn ones")
      ->capture_default_str()
      ->check(CLI::Range(1, kMaxGoals));
}

void add_dataset_parameters(CLI::App& app, Source& source) {
  for (const auto* entry : DatasetRegistry::instance().entries())
    add_parameters(app, entry->name, entry->parameters, source.parameters[entry->name]);
}

void add_selection_options(CLI::App& app, Selection& selection, const std::string& group) {
  const OptionGroup options(app, group);
  app.add_option_function<std::string>(
         "--frames",
         [&selection](const std::string& text) {
           selection.first = 0;
           selection.end = std::numeric_limits<int>::max();
           read_range("--frames", text, selection.first, selection.end);
           if (selection.first < 0) throw CLI::ValidationError("--frames", "must begin at frame 0 or later");
         },
         "Frames of the recording, END not included; either may be left out")
      ->type_name("FIRST:END");
  app.add_option_function<std::string>(
         "--metres",
         [&selection](const std::string& text) {
           selection.from = -std::numeric_limits<double>::infinity();
           selection.to = std::numeric_limits<double>::infinity();
           read_range("--metres", text, selection.from, selection.to);
         },
         "Part of the route, in metres from its beginning; either may be left out")
      ->type_name("FROM:TO");
  CLI::Option* step = app.add_option("--step", selection.step, "Take every STEP-th frame")
                          ->capture_default_str()
                          ->check(CLI::Range(1, 1 << 20));
  app.add_option("--step-metres", selection.step_metres,
                 "Take the next frame that is at least this many metres further on")
      ->check(CLI::Range(0.05, 1e6))
      ->excludes(step);
  app.add_option("--align-to", selection.align,
                 "Align frames to this sibling traversal, or each of A+B to that of C+D; --frames, --metres and --step "
                 "then refer to it")
      ->type_name("NAME");
  app.add_option("--align-by", selection.by,
                 "How to match the frames of both: as the dataset suggests, or another way; sight: by what they show")
      ->capture_default_str()
      ->check(CLI::IsMember({"dataset", "index", "matches", "distance", "gps", "sight"}));
  app.add_option("--align-within", selection.tolerance,
                 "Largest distance to the nearest frame, metres (for distance and gps)")
      ->capture_default_str()
      ->check(CLI::Range(0.01, 1e5));
  app.add_option_function<std::string>(
         "--on-bad-frame", [&selection](const std::string& text) { selection.skip_bad_frames = text == "skip"; },
         "Refuse the traversal, or skip the frame and show the nearest good one")
      ->check(CLI::IsMember({"refuse", "skip"}))
      ->default_str("refuse");
}

std::unique_ptr<Dataset> open_dataset(const Source& source) {
  const auto& entry = DatasetRegistry::instance().find("dataset", source.dataset);
  for (const auto& [name, given] : source.parameters)
    if (name != source.dataset && !given.empty())
      throw Error("is for dataset " + name + ", but the dataset is " + source.dataset,
                  "--" + name + "-" + given.begin()->first);
  const auto given = source.parameters.find(source.dataset);
  auto dataset =
      entry.create(Parameters("dataset " + entry.name, entry.parameters,
                              given == source.parameters.end() ? std::map<std::string, double>() : given->second),
                   source.folder);
  dataset->walk_by(source.rule);
  if (source.dataset == "plain" && is_folder(source.folder)) warn_of_arrays(source.folder);
  return dataset;
}

std::string chosen_traversal(Dataset& dataset, const Source& source) {
  if (source.condition.empty()) return source.traversal;
  std::vector<std::string> found, conditions;
  for (const std::string& name : dataset.names()) {
    const std::string condition = dataset.condition(name);
    if (condition == source.condition) found.push_back(name);
    if (!condition.empty() && std::find(conditions.begin(), conditions.end(), condition) == conditions.end())
      conditions.push_back(condition);
  }
  if (found.empty())
    throw Error("no traversal was recorded under '" + source.condition + "'", "--condition",
                conditions.empty() ? "the dataset states no conditions" : "there are: " + joined(conditions));
  if (found.size() > 1)
    throw Error(std::to_string(found.size()) + " traversals were recorded under '" + source.condition + "'",
                "--condition", "name one with --traversal: " + joined(found));
  return found.front();
}

}  // namespace citylearn
