// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "env_service/dataset_io/dataset.h"

namespace citylearn {

/// A frame or a whole traversal (frame -1) that cannot be read.
struct Fault {
  std::string traversal;
  int frame = -1;
  std::string name;  ///< of the frame; empty for a traversal
  std::string what;
};

/// Where frames of two recordings show the same places, by sight.
struct SightMatch {
  std::string route, other;
  int frames = 0;                 ///< of the other
  std::vector<int> counterparts;  ///< of each frame of the route, a frame of the other; -1: none
  std::vector<float> confidence;  ///< of each, 0 to 1
};

/// Where a recording went, degrees; NaN: unknown.
struct Route {
  std::string name;
  std::vector<double> latitude, longitude;
};

struct Inspection {
  long frames = 0;  ///< looked at
  std::vector<Fault> faults;
  std::vector<std::string> not_taken;  ///< lines on kinds of files that are not taken and should be
  std::vector<std::string> left_out;   ///< lines on files that are not taken, on purpose
  std::vector<std::string> notes;      ///< lines on what may be meant or not, and is not a fault
  std::vector<Route> routes;           ///< of recordings with latitude and longitude
  std::vector<SightMatch> matches;     ///< of recordings that were compared by sight
};

/// Loads every traversal of the dataset in `folder`, decodes every frame, and looks for files that are not taken: of
/// the user's own recordings they are faults, but for texts. Tables and side files are passed over. Calls `progress`
/// with the frames done and in all after each frame, and ends when it returns false.
Inspection inspect(Dataset& dataset, const std::string& folder,
                   const std::function<bool(long done, long all)>& progress);

/// The facts that `info` prints about a traversal.
struct Summary {
  std::string name, condition;
  int frames = 0, dimension = 0;
  std::string pixels;    ///< width and height of the first good frame, "640x480"; empty without pictures
  int bad_frames = 0;    ///< as far as can be seen without decoding
  double metres = 0;     ///< length of the route, NaN when unknown
  double mean_step = 0;  ///< metres between frames, NaN when unknown
  bool gps = false;
  std::string
      places;  ///< what tells where frames are: a file, "EXIF", "names"; empty: unknown, or as the dataset has it
  std::string error;  ///< why it cannot be loaded
};
Summary summarise(Dataset& dataset, const std::string& name);

/// Returns the table that `info` prints: headings, then a line for each traversal; columns as wide as their contents.
std::string to_table(const std::vector<Summary>& summaries);
/// Returns the routes, and what was compared by sight, as a picture in SVG.
std::string to_svg(const Inspection& inspection);

}  // namespace citylearn
