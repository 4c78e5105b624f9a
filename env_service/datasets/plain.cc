// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>

#include "core/task/live.h"
#include "core/util/text.h"
#include "env_service/dataset_io/features.h"
#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/dataset_io/photographs.h"
#include "env_service/dataset_io/tracks.h"
#include "env_service/files/files.h"
#include "env_service/traversal/poses.h"
#include "env_service/traversal/street_views.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

const std::string kMatches = "matches.csv";
const std::string kPoses = ".poses.csv";
constexpr double kTrackReach = 1;  // seconds beyond a track in which its ends still hold: receivers tell one a second
constexpr int kPictureDepth = 3;   // folders below that of a traversal in which its pictures may lie

/// Your own traversals. Each is one of
///   NAME.csv           features: a frame a line, separated by commas, no header
///   NAME/              a folder of pictures, or that holds one with them, in the order of pictures_in()
///   NAME.mp4, .avi ... a film, or a folder NAME with one; all its chapters are one film
/// Where nodes.txt and links.txt (StreetGraph) lie beside them, their frames may be views of that map (show_states).
/// Where frames are, says the first of these that is there: NAME.poses.csv (or NAME/poses.csv) beside it (poses.h), a
/// track NAME.gpx, .nmea, .kml or .geojson, a film's own track or NAME.srt, the pictures' EXIF data, or the only track
/// there. Tracks may lie in NAME/ too. matches.csv says which frames of two traversals are the same place.
class Plain : public FolderDataset {
 public:
  Plain(const std::string& folder, const Parameters& parameters) : Plain("plain", folder, parameters["clock-offset"]) {}

  std::vector<std::string> names() override {
    std::vector<std::string> names;
    for (const auto& [name, path] : sources()) names.push_back(name);
    return names;
  }

  bool distinctive() override { return false; }

  Correspondence correspondence() const override {
    return matches_file().empty() ? Correspondence::kIndex : Correspondence::kMatches;
  }

  std::shared_ptr<const StreetGraph> streets() override { return own_map() ? own_map() : FolderDataset::streets(); }

  std::vector<std::pair<int, int>> matches(const std::string& a, const std::string& b) override {
    return matches_file().empty() ? Dataset::matches(a, b) : read_matches(matches_file(), a, b);
  }

 protected:
  Plain(const std::string& dataset, const std::string& folder, double clock_offset)
      : FolderDataset(dataset, folder, "NAME.csv files"), clock_offset_(clock_offset) {}

 private:
  Traversal read(const std::string& name) override {
    const std::vector<std::string> paths = sources().at(name);
    Traversal traversal = recorded_at(name, paths);
    if (const auto map = rule_ == StateRule::kLine ? nullptr : own_map()) show_states(traversal, *map, rule_, paths[0]);
    return traversal;
  }

  std::shared_ptr<const StreetGraph> own_map() {
    if (!own_map_) own_map_ = StreetGraph::find_in(folder_);
    return own_map_;
  }

  Traversal recorded_at(const std::string& name, const std::vector<std::string>& paths) const {
    const std::string& path = paths[0];
    double began = std::nan("");  // when the clock of the frames' times was 0
    std::vector<double> begins;   // of a film's chapters, on it
    Traversal traversal = is_folder(path)                 ? photographed(name, path, began)
                          : lower(path).ends_with(".csv") ? featured(name, path)
                                                          : filmed(name, paths, &began, &begins);
    const std::string inside = folder_ + "/" + name + "/poses.csv";
    std::vector<std::string> poses;
    for (const std::string& file : files_in(folder_, {kPoses}))
      if (file.starts_with(name) && file.size() == name.size() + kPoses.size()) poses.push_back(folder_ + "/" + file);
    if (is_file(inside)) poses.push_back(inside);
    if (poses.size() > 1) throw Error("there is " + poses[1] + " too", poses[0], "remove one of them");
    if (!poses.empty()) {
      traversal.places_from = path_below(poses[0], folder_);
      read_poses(poses[0], traversal);
      return traversal;
    }
    if (traversal.times.empty()) return traversal;
    const std::vector<std::string> tracks = files_of(name, track_suffixes());
    for (const std::string& suffix : track_suffixes())
      for (const std::string& track : tracks)
        if (lower(track).ends_with(suffix) && is_called(track, name, path)) {
          follow(traversal, track, began);
          return traversal;
        }
    if (!is_folder(path) && follow_own(traversal, paths, begins)) return traversal;
    if (tracks.size() == 1 && traversal.places_from.empty()) try {
        follow(traversal, tracks[0], began);
      } catch (const Error& error) {  // it may be another drive's
        spdlog::warn("{}: {}", name, error.what());
      }
    return traversal;
  }

  /// Returns the paths, below the dataset's folder, of files in a traversal's folder and beside it.
  std::vector<std::string> files_of(const std::string& name, const std::vector<std::string>& suffixes) const {
    std::vector<std::string> found = files_in(folder_, suffixes);
    if (is_folder(folder_ + "/" + name))
      for (const std::string& file : files_in(folder_ + "/" + name, suffixes)) found.push_back(name + "/" + file);
    return found;
  }
  static bool is_called(const std::string& file, const std::string& name, const std::string& path) {
    const std::string stem = lower(stem_of(file));
    return stem == lower(name) || stem == lower(stem_of(path));
  }

  /// Gives a film's frames their places on the track that it holds itself, or that NAME.srt holds. Returns false when
  /// there is none.
  bool follow_own(Traversal& traversal, const std::vector<std::string>& film, const std::vector<double>& begins) const {
    std::string kind;
    GpsRows rows;
    for (std::size_t i = 0; i < film.size(); ++i) {
      const GpsRows chapter = read_film_track(film[i], kind);
      if (rows.log.empty()) rows.log = chapter.log;
      for (std::size_t row = 0; row < chapter.times.size(); ++row)
        rows.add(begins[i] + chapter.times[row], chapter.latitude[row], chapter.longitude[row], chapter.height[row]);
    }
    for (const std::string& file : files_of(traversal.name, {".srt"}))
      if (rows.times.empty() && is_called(file, traversal.name, film[0])) {
        rows = read_film_track(folder_ + "/" + file, kind);
        kind = file;
      }
    if (rows.times.empty()) return false;
    locate(traversal, rows, kTrackReach);
    traversal.places_from = kind;
    return true;
  }

  /// Gives the frames their places on a track, by time. Throws Error where nothing says which frame was where.
  void follow(Traversal& traversal, const std::string& track, double began) const {
    const std::string path = folder_ + "/" + track;
    GpsRows rows = read_track(path, std::isnan(began) ? 0 : began + traversal.times[0] + clock_offset_);
    std::string why;
    const auto found =
        std::isnan(began) && clock_offset_ == 0 ? search_film_start(traversal, rows, kTrackReach, why) : 0;
    if (!found)
      throw Error(
          "nothing says which time of it is that of the first frame of " + traversal.name +
              ", not its motion either: " + why,
          path, "give --plain-clock-offset, the seconds from its first point to second 0 of the frames (not 0: .001)");
    // Second 0 of the frames, on the track's clock.
    const double zero = (!std::isnan(began) ? began : *found != 0 ? *found : rows.times[0]) + clock_offset_;
    for (double& time : rows.times) time -= zero;
    if (began > 0 && clock_offset_ == 0) {  // photographs' times are of the day itself
      const double start = find_film_start(traversal, rows, kTrackReach, traversal.name);
      for (double& time : rows.times) time -= start;
    }
    const std::vector<double>& times = traversal.times;
    if (times.back() < rows.times.front() || times[0] > rows.times.back()) {
      std::vector<double> zones;  // those in which it would be of the same time
      for (double zone = -14 * 3600; zone <= 14 * 3600; zone += 3600)
        if (rows.times.front() - kTrackReach <= times[0] + zone &&
            times.back() + zone <= rows.times.back() + kTrackReach)
          zones.push_back(clock_offset_ + zone);
      const std::string remedy =
          zones.size() == 1 ? fmt::format("is one clock in another zone? Then give --plain-clock-offset {}", zones[0])
                            : "move it away, or give --plain-clock-offset";
      throw Error(fmt::format("is of another time than {}: from {:.0f} to {:.0f} s of its clock", traversal.name,
                              rows.times.front(), rows.times.back()),
                  path, remedy);
    }
    locate(traversal, rows, kTrackReach);
    traversal.places_from = track;
    const auto outside = std::count_if(traversal.latitude.begin(), traversal.latitude.end(),
                                       [](double degrees) { return std::isnan(degrees); });
    if (outside > 0)
      spdlog::warn("{}: tells no place of {} of {} frames of {}", path, outside, traversal.frames, traversal.name);
  }

  /// Returns the pictures of a folder, or of the only folder below it that has any: by time, where they tell theirs.
  Traversal photographed(const std::string& name, const std::string& path, double& began) const {
    const std::vector<std::string> folders = picture_folders(path, kPictureDepth);
    if (folders.size() > 1 && folders[0] != path)
      throw Error("has pictures in " + path_below(folders[0], path) + " and in " + path_below(folders[1], path), path,
                  "put all of one drive into one folder, or give a folder below with --data");
    if (folders.size() > 1) spdlog::warn("{}: pictures in {} are not read", path, path_below(folders[1], path));
    std::map<std::string, std::pair<Taken, double>> known;  // of each file, with its time in UTC
    std::vector<std::string> paths = pictures_in(folders[0], [&](const std::vector<std::string>& files) {
      std::vector<Taken> taken;
      for (const std::string& file : files) taken.push_back(read_taken(folders[0] + "/" + file));
      std::vector<double> times = utc_of(taken, path);
      for (std::size_t i = 0; i < files.size(); ++i) known[files[i]] = {taken[i], times[i]};
      return times;
    });
    std::vector<double> times, latitude, longitude;
    std::size_t timed = 0, located = 0;
    for (std::string& file : paths) {
      const auto& [taken, time] = known[file];
      times.push_back(time);
      latitude.push_back(taken.latitude);
      longitude.push_back(taken.longitude);
      timed += std::isfinite(time);
      located += std::isfinite(taken.latitude);
      file.insert(0, folders[0] + "/");
    }
    Traversal traversal = pictured(name, std::move(paths), path);
    if (timed == times.size() && std::is_sorted(times.begin(), times.end())) {
      traversal.times = std::move(times);
      began = 0;
    }
    if (located == 0) return traversal;
    if (located < latitude.size())
      spdlog::warn("{}: {} of {} pictures do not say where they were taken", path, latitude.size() - located,
                   latitude.size());
    locate(traversal, std::move(latitude), std::move(longitude));
    traversal.places_from = "EXIF";
    return traversal;
  }

  Traversal featured(const std::string& name, const std::string& path) const {
    if (name.size() > 64) throw Error("the name of a traversal may have 64 characters", path);
    Traversal traversal;
    traversal.dataset = dataset_;
    traversal.name = name;
    read_features(path, traversal);
    traversal.positions.assign(static_cast<std::size_t>(traversal.frames), std::numeric_limits<float>::quiet_NaN());
    return traversal;
  }

  static bool begins_with_a_letter(const std::string& path) {
    std::ifstream file(path);
    char first = 0;
    return file >> first && (std::isalpha(static_cast<unsigned char>(first)) || first == '"');
  }

  /// Returns the path of each traversal, by name; of a film those of its chapters.
  std::map<std::string, std::vector<std::string>> sources() const {
    std::map<std::string, std::vector<std::string>> found;
    const auto add = [&](const std::string& name, const std::vector<std::string>& files) {
      const auto [at, added] = found.try_emplace(name);
      if (name.find(',') != name.npos)
        throw Error("'" + name + "' has a comma, as there is between names", folder_, "rename it");
      if (!added)
        throw Error(
            "traversal '" + name + "' is both " + fs::path(at->second[0]).filename().string() + " and " + files[0],
            folder_, "rename or remove one of them");
      for (const std::string& file : files) at->second.push_back(folder_ + "/" + file);
    };
    try {
      for (const auto& film : films_in(folder_, "")) add(stem_of(film[0]), film);
      for (const std::string& name : folders_in(folder_))
        if (!picture_folders(folder_ + "/" + name, kPictureDepth).empty())
          add(name, {name});
        else if (const auto films = films_in(folder_, name); films.size() == 1)
          add(name, films[0]);
      // Beside pictures, a table whose columns have names describes them. Where there are no pictures, it is meant
      // as features, and reading it will say what is wrong.
      const bool pictures = !found.empty();
      for (const std::string& file : files_in(folder_, {".csv"}))
        if (file != kMatches && !lower(file).ends_with(kPoses) &&
            !(pictures && begins_with_a_letter(folder_ + "/" + file)))
          add(file.substr(0, file.size() - 4), {file});
    } catch (const Error& error) {
      if (is_folder(folder_)) throw;
      throw Error(error.what(), "", "--data names the folder that holds NAME/, NAME.mp4 or NAME.csv");
    }
    if (found.empty() && !picture_folders(folder_, 0).empty())
      throw Error("holds pictures itself", folder_,
                  "--data names the folder above, in which each folder is a traversal");
    return found;
  }

  const double clock_offset_;                   ///< seconds
  std::shared_ptr<const StreetGraph> own_map_;  ///< null: not read, or not there
};

/// A robot on a route that it was taught, which is a traversal of Plain.
class Live : public Plain {
 public:
  Live(const std::string& folder, const Parameters&) : Plain(kLive, folder, 0) {}
};

const DatasetRegistry::Registration live_registration({
    kLive,
    "a robot that drives a route which it was taught: --data has the route as dataset plain, --camera and --position "
    "are topics of ROS 2",
    {},
    open_folder<Live>,
    {},
    {{"paper", "none"}, {"address", "your own robot"}, {"licence", "yours"}, {"size", "any"}},
});

const DatasetRegistry::Registration plain_registration({
    "plain",
    "a folder (--data) of traversals: NAME.csv (one frame a line, comma-separated features, no header), a folder NAME "
    "of pictures, or a video NAME.mp4; NAME.poses.csv, a track NAME.gpx, EXIF data and matches.csv may give places, "
    "nodes.txt and links.txt, or an extract of OpenStreetMap, a map of streets",
    {{"clock-offset",
      "seconds by which a track's clock is ahead of the frames'; of films that do not say when they began: from the "
      "track's first point to second 0",
      0, -1e9, 1e9}},
    open_folder<Plain>,
    {},
    {{"paper", "none"}, {"address", "your own recordings"}, {"licence", "yours"}, {"size", "any"}},
});

}  // namespace
}  // namespace citylearn
