// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "env_service/dataset_io/dataset.h"

namespace citylearn {

struct StreetCoverage;

/// A dataset that reads one folder. Every Error names the folder or file.
class FolderDataset : public Dataset {
 public:
  /// Throws Error when no folder was given. `contents` says what the folder of this dataset holds.
  FolderDataset(const std::string& dataset, const std::string& folder, const std::string& contents);
  /// Reads the traversal and sets its condition. Throws Error when names() does not have `name`.
  Traversal load(const std::string& name) final;
  /// Returns the streets of the extract of OpenStreetMap in the folder, null where there is none. Under --rule street
  /// each of their links shows the frames that were taken there (StreetCoverage).
  std::shared_ptr<const StreetGraph> streets() override;
  std::vector<std::string> describe_streets() final;

 protected:
  virtual Traversal read(const std::string& name) = 0;
  /// Returns whether frames follow each other on a drive, so that places which no vehicle can have reached are faults.
  virtual bool drives() const { return true; }

  /// Throws Error unless `name` is among names().
  void require_known(const std::string& name);
  /// Throws Error: the folder is not of this dataset, as `missing` is not there.
  [[noreturn]] void not_recognised(const std::string& missing) const;
  /// Returns the names of traversals whose paths are `paths`. Throws as not_recognised() where there are none.
  std::vector<std::string> names_of(const std::map<std::string, std::string>& paths, const std::string& missing) const;

  /// Returns the path of matches.csv (poses.h), empty where there is none.
  std::string matches_file() const;

  /// Returns a traversal whose frames are not filled in and whose positions are not known yet. Throws Error naming
  /// `where` when it has less than 2 frames or more than msg::MAX_FRAMES.
  Traversal unfilled(const std::string& name, int frames, const std::string& where) const;
  /// Returns a traversal with these images, likewise.
  Traversal pictured(const std::string& name, std::shared_ptr<Images> images, const std::string& where) const;
  /// Returns a traversal of image files.
  Traversal pictured(const std::string& name, std::vector<std::string> paths, const std::string& where) const;
  /// Returns the traversal of a film, whose chapters these videos are, with the times of its frames. `began` as
  /// video_frames() has it; `begins` becomes the time of each video's own second 0.
  Traversal filmed(const std::string& name, const std::vector<std::string>& videos, double* began = nullptr,
                   std::vector<double>* begins = nullptr) const;
  /// Returns the traversal of a folder of numbered pictures, or of a video.
  Traversal recorded(const std::string& name, const std::string& path) const;

  const std::string dataset_, folder_;

 private:
  /// Returns a traversal as read() does, with its condition and without impossible places.
  Traversal checked(const std::string& name);
  const StreetCoverage& coverage();
  void show_links(Traversal& traversal);

  std::shared_ptr<const StreetGraph> osm_;          ///< null: not read, or not there
  std::map<std::string, std::vector<int>> shown_;   ///< frames_along_links() of osm_, by the recordings read since
  std::shared_ptr<const StreetCoverage> coverage_;  ///< null: not found yet
};

/// Creates a dataset that has a constructor from folder and parameters.
template <class T>
std::unique_ptr<Dataset> open_folder(const Parameters& parameters, const std::string& folder) {
  return std::make_unique<T>(folder, parameters);
}

/// Gives the frames latitude and longitude (degrees, NaN where unknown), and positions from them.
void locate(Traversal& traversal, std::vector<double> latitude, std::vector<double> longitude);

/// Latitude and longitude in a GPS log, a row each; with its times, and heights (metres), where the log has them.
struct GpsRows {
  std::vector<double> latitude, longitude, times = {}, height = {};
  std::string log = {};  ///< the file or folder, for messages

  void add(double time, double north, double east, double up = std::numeric_limits<double>::quiet_NaN());
  /// Returns whether `time` is before the last row's.
  bool falls(double time) const { return !times.empty() && time < times.back(); }
};
/// Gives the frames latitude, longitude, height and positions at their times, up to `reach` seconds beyond the log, and
/// none between rows of unknown place. Ignores fixes that no vehicle can have reached, as rows that were copied from
/// another log, and says so in one warning.
void locate(Traversal& traversal, const GpsRows& rows, double reach);
/// Reads "latitude, longitude" in degrees (further columns are skipped; the separator is a comma or blanks; a first row
/// of words is a header). 0, 0 is not a fix. Throws Error naming the line where a field is not a number or out of
/// range.
GpsRows read_gps_rows(const std::string& path);
/// Assigns rows to frames: row i to frame i when there are about as many (within a twentieth); else spreads the log
/// evenly over the recording.
GpsRows spread(const GpsRows& rows, int frames);

}  // namespace citylearn
