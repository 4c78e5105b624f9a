// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <map>
#include <optional>
#include <string>

#include "env_service/dataset_io/dataset.h"

namespace CLI {
class App;
}

namespace citylearn {

/// Selects the frames of a recording that become the traversal, and how they align with a sibling's.
struct Selection {
  // Begin and end, in frames and metres of the recording or, when it is aligned, of the sibling.
  int first = 0;                                           ///< --frames FIRST:END, 0-based
  int end = std::numeric_limits<int>::max();               ///< half open; beyond the recording is an Error when given
  double from = -std::numeric_limits<double>::infinity();  ///< --metres FROM:TO along the route
  double to = std::numeric_limits<double>::infinity();

  // Spacing.
  int step = 1;            ///< --step: every step-th frame
  double step_metres = 0;  ///< --step-metres: least distance to the next frame, 0.05 or more; 0: not by metres

  // Alignment.
  std::string align = {};      ///< --align-to: the sibling; empty: none
  std::string by = "dataset";  ///< --align-by: dataset (as it suggests), index, matches, distance, gps, sight
  double tolerance = 25;  ///< --align-within, metres: a place without a frame this near is an Error (gps, distance)

  bool skip_bad_frames =
      false;  ///< --on-bad-frame skip: the nearest good frame replaces a bad one; else bad frames are an Error
};

/// Loads traversal `name`, cuts and thins it; or, when it is to be aligned, cuts and thins its sibling and picks the
/// frame at the same place for each frame of that. Then refuses broken frames, or replaces each by the nearest good one
/// of the recording (logging up to 20 by name); a frame keeps its own position. With nothing selected and nothing
/// broken the traversal is as the dataset loads it, hash() included. A map of streets is taken whole, and aligned by
/// index; where rule street has none, one is made of the drive (streets_driven). Throws Error naming option or frame.
Traversal select(Dataset& dataset, const std::string& name, const Selection& selection);

/// The options that name a traversal, the same in every program: a dataset, its folder and parameters, a traversal by
/// name or condition, a selection.
struct Source {
  std::string dataset = "synthetic";
  std::string folder;
  std::map<std::string, std::map<std::string, double>> parameters;  ///< as given, by dataset
  std::optional<StateRule> rule;                                    ///< --rule: how agents walk; as the frames fit
  std::string traversal = "summer";
  std::string condition;  ///< --condition: the one traversal recorded under it, instead of --traversal
  std::string goal;       ///< --goal-place: as with_goal() takes it; empty: goals are drawn
  Selection selection;
};

/// Adds --dataset, --data, --rule and --DATASET-PARAMETER for each parameter of each dataset; `group` heads them in
/// --help.
void add_dataset_options(CLI::App& app, Source& source, const std::string& group);
/// Adds these, --traversal and --condition.
void add_source_options(CLI::App& app, Source& source, const std::string& group);
/// Adds --goal-place.
void add_goal_option(CLI::App& app, Source& source);
/// Adds --DATASET-PARAMETER alone.
void add_dataset_parameters(CLI::App& app, Source& source);
/// Adds --frames, --metres, --step, --step-metres, --align-to, --align-by, --align-within and --on-bad-frame.
void add_selection_options(CLI::App& app, Selection& selection, const std::string& group);
/// Returns the dataset to read the folder as: that of the parameters given, else the first recognised, else "plain".
std::string dataset_of(const Source& source);
/// Opens the dataset. Throws Error when it is unknown or parameters of another dataset were given.
std::unique_ptr<Dataset> open_dataset(const Source& source);
/// Returns the name of the traversal. Throws Error when none or several were recorded under the condition.
std::string chosen_traversal(Dataset& dataset, const Source& source);

}  // namespace citylearn
