// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <map>
#include <string>

#include "env_service/dataset_io/dataset.h"

namespace CLI {
class App;
}

namespace citylearn {

/// Which frames of a recording become the traversal that agents walk, and in which order they stand beside a sibling's.
struct Selection {
  // Where it begins and ends. Frames and metres are those of the recording itself or, when it is aligned, of the
  // sibling.
  int first = 0;                                           ///< --frames FIRST:END, 0-based
  int end = std::numeric_limits<int>::max();               ///< half open; beyond the recording is an Error when given
  double from = -std::numeric_limits<double>::infinity();  ///< --metres FROM:TO along the route
  double to = std::numeric_limits<double>::infinity();

  // How far apart frames are.
  int step = 1;            ///< --step: every step-th frame
  double step_metres = 0;  ///< --step-metres: the next frame at least so far on, 0.05 or more; 0 = not by metres

  // Which place each frame is.
  std::string align = {};      ///< --align-to: sibling whose frame i shall be the same place; empty: none
  std::string by = "dataset";  ///< --align-by: dataset (its natural way), index, matches, distance, gps
  double tolerance = 25;       ///< --align-within, metres: a place without a frame as near is an Error (gps, distance)

  bool skip_bad_frames = false;  ///< --on-bad-frame skip: the nearest good frame stands in; else they are an Error
};

/// Loads traversal `name`, cuts it out and thins it; or, when it is to be aligned, does that to its sibling and picks
/// for each of its frames the one at the same place. Then each broken frame among them is refused, or the nearest good
/// one of the recording stands in (logging each by name; more than 20 are counted); a frame's position remains its own.
/// With nothing selected and nothing broken the traversal is as the dataset loads it, hash() included.
/// Throws Error that names the option or the frame.
Traversal select(Dataset& dataset, const std::string& name, const Selection& selection);

/// What a person says to get a traversal: a dataset, its folder and parameters, a traversal by name or condition, a
/// selection. The same options in every program.
struct Source {
  std::string dataset = "synthetic";
  std::string folder;
  std::map<std::string, std::map<std::string, double>> parameters;  ///< those given, by dataset
  std::string traversal = "summer";
  std::string condition;  ///< --condition: the one traversal recorded under it, instead of --traversal
  Selection selection;
};

/// --dataset, --data, one --DATASET-PARAMETER each; `group` heads them in --help.
void add_dataset_options(CLI::App& app, Source& source, const std::string& group);
/// --frames, --metres, --step, --step-metres, --align-to, --align-by, --align-within, --on-bad-frame.
void add_selection_options(CLI::App& app, Selection& selection, const std::string& group);
/// The dataset asked for. Throws Error: unknown, or parameters of another one were given.
std::unique_ptr<Dataset> open_dataset(const Source& source);
/// Name of the traversal asked for. Throws Error: none was, or several were, recorded under the condition.
std::string chosen_traversal(Dataset& dataset, const Source& source);

}  // namespace citylearn
