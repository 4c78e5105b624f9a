// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/folder_dataset.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "core/files/files.h"
#include "core/wire/messages.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/files/times.h"
#include "env_service/geometry/geometry.h"
#include "env_service/images/image_sources.h"
#include "env_service/traversal/places.h"
#include "env_service/traversal/street_coverage.h"
#include "env_service/traversal/street_views.h"

namespace citylearn {

FolderDataset::FolderDataset(const std::string& dataset, const std::string& folder, const std::string& contents)
    : dataset_(dataset), folder_(folder) {
  if (folder.empty()) throw Error("needs a folder of " + contents, "dataset " + dataset, "give it with --data DIR");
}

Traversal FolderDataset::load(const std::string& name) {
  require_known(name);
  if (on_streets()) streets();
  Traversal traversal = checked(name);
  if (on_streets() && !traversal.streets && osm_) show_links(traversal);
  return traversal;
}

Traversal FolderDataset::checked(const std::string& name) {
  Traversal traversal = read(name);
  traversal.condition = condition(name);
  if (std::any_of(traversal.positions.begin(), traversal.positions.end(), [](float x) { return std::isinf(x); }))
    throw Error("traversal '" + name + "' has places that are too far apart to measure", folder_, "mend its positions");
  if (drives() && !traversal.streets) forget_impossible(traversal, folder_);
  if (osm_) shown_[name] = frames_along_links(traversal, *osm_);
  return traversal;
}

std::shared_ptr<const StreetGraph> FolderDataset::streets() {
  if (!osm_) osm_ = StreetGraph::find_osm_in(folder_);
  return osm_;
}

std::vector<std::string> FolderDataset::describe_streets() {
  std::vector<std::string> lines = Dataset::describe_streets();
  if (osm_) lines.push_back(coverage().summary);
  return lines;
}

const StreetCoverage& FolderDataset::coverage() {
  if (coverage_) return *coverage_;
  for (const std::string& name : names())
    if (!shown_.contains(name)) checked(name);
  coverage_ = std::make_shared<const StreetCoverage>(find_coverage(*osm_, shown_));
  return *coverage_;
}

/// Makes the frames of a recording those of the links of the extract that it shows.
void FolderDataset::show_links(Traversal& traversal) {
  if (rule_ != StateRule::kStreet)
    throw Error("a map of OpenStreetMap is walked along its links", "--rule", "take street");
  spdlog::info(osm_->about());
  spdlog::info(coverage().summary);
  const auto shown = coverage().frames.find(traversal.name);
  if (shown == coverage().frames.end())
    throw Error("traversal '" + traversal.name + "' has no latitude and longitude that say which streets it shows",
                folder_, "add a track or poses, or give --rule line");
  if (coverage().part->links() == 0)
    throw Error("no streets lead there and back of which all recordings have a view (" + coverage().summary + ")",
                folder_, "move recordings of other places away; one needs a position every 15 m, and to close a loop");
  if (traversal.images) traversal.images = picked(traversal.images, shown->second);
  traversal.keep(shown->second);
  show_states(traversal, *coverage().part, rule_, traversal.name);
}

void FolderDataset::require_known(const std::string& name) {
  const std::vector<std::string> known = names();
  if (std::find(known.begin(), known.end(), name) == known.end()) throw unknown_traversal(name, folder_, known);
}

void FolderDataset::not_recognised(const std::string& missing) const {
  throw Error("is not the dataset " + dataset_ + ": there is no " + missing, folder_,
              is_folder(folder_) ? "--data names the folder that holds it" : "there is no such folder");
}

std::vector<std::string> FolderDataset::names_of(const std::map<std::string, std::string>& paths,
                                                 const std::string& missing) const {
  if (paths.empty()) not_recognised(missing);
  std::vector<std::string> names;
  for (const auto& [name, path] : paths) names.push_back(name);
  return names;
}

std::string FolderDataset::matches_file() const { return first_file(folder_, {"matches.csv"}); }

Traversal FolderDataset::unfilled(const std::string& name, int frames, const std::string& where) const {
  const std::string count = "has " + (frames == 1 ? "only one frame" : std::to_string(frames) + " frames");
  if (frames < 2) throw Error(count + ", a route needs two", where);
  if (frames > static_cast<int>(msg::MAX_FRAMES))
    throw Error(count + ", more than " + std::to_string(msg::MAX_FRAMES), where);
  if (name.size() > 64) throw Error("the name of a traversal may have 64 characters", where);
  Traversal traversal;
  traversal.dataset = dataset_;
  traversal.name = name;
  traversal.frames = frames;
  traversal.positions.assign(static_cast<std::size_t>(frames), std::numeric_limits<float>::quiet_NaN());
  return traversal;
}

Traversal FolderDataset::pictured(const std::string& name, std::shared_ptr<Images> images,
                                  const std::string& where) const {
  Traversal traversal = unfilled(name, images->frames(), where);
  traversal.images = std::move(images);
  return traversal;
}

Traversal FolderDataset::pictured(const std::string& name, std::vector<std::string> paths,
                                  const std::string& where) const {
  return pictured(name, image_files(std::move(paths), folder_), where);
}

Traversal FolderDataset::filmed(const std::string& name, const std::vector<std::string>& videos, double* began,
                                std::vector<double>* begins) const {
  std::vector<double> times, chapter;
  std::vector<std::shared_ptr<Images>> parts;
  bool timed = true;
  for (const std::string& video : videos) {
    parts.push_back(video_frames(video, folder_, &chapter, parts.empty() ? began : nullptr));
    timed = timed && !chapter.empty();
    if (!timed) continue;
    // The first picture of a chapter follows the last one before it as that one follows its own.
    const double begin = times.size() < 2 ? 0 : 2 * times.back() - times[times.size() - 2] - chapter[0];
    if (begins) begins->push_back(begin);
    for (const double time : chapter) times.push_back(begin + time);
  }
  Traversal traversal = pictured(name, parts.size() == 1 ? parts[0] : joined(std::move(parts)), videos[0]);
  if (timed) traversal.times = std::move(times);
  return traversal;
}

Traversal FolderDataset::recorded(const std::string& name, const std::string& path) const {
  if (!is_folder(path)) return filmed(name, {path});
  std::vector<std::string> paths;
  for (const NumberedFile& file : numbered_files(path, image_suffixes())) paths.push_back(file.path);
  return pictured(name, std::move(paths), path);
}

void locate(Traversal& traversal, std::vector<double> latitude, std::vector<double> longitude) {
  traversal.positions = metres_along(latitude, longitude);
  traversal.latitude = std::move(latitude);
  traversal.longitude = std::move(longitude);
}

void GpsRows::add(double time, double north, double east, double up) {
  times.push_back(time);
  latitude.push_back(north);
  longitude.push_back(east);
  height.push_back(up);
}

void locate(Traversal& traversal, const GpsRows& rows, double reach) {
  GpsRows checked = rows, kept;
  fill_heights(checked.height);
  const std::vector<std::size_t> jumps = forget_impossible(
      {checked.latitude, checked.longitude, rows.times, true, rows.log, "GPS fixes",
       [&](std::size_t row) { return fmt::format("{:.0f} s into the log", rows.times[row] - rows.times[0]); }, false});
  for (std::size_t row = 0; row < rows.times.size(); ++row) {
    if (std::isnan(rows.latitude[row])) kept.add(rows.times[row], kUnknown, kUnknown);
    if (std::isnan(checked.latitude[row])) continue;
    // Nothing is known of the frames within a jump.
    if (std::find(jumps.begin(), jumps.end(), row) != jumps.end())
      kept.add((kept.times.back() + rows.times[row]) / 2, kUnknown, kUnknown);
    kept.add(rows.times[row], checked.latitude[row], checked.longitude[row],
             checked.height.empty() ? kUnknown : checked.height[row]);
  }
  traversal.height = interpolate(kept.times, kept.height, traversal.times, reach);
  locate(traversal, interpolate(kept.times, kept.latitude, traversal.times, reach),
         interpolate_longitude(kept.times, kept.longitude, traversal.times, reach));
}

GpsRows read_gps_rows(const std::string& path) {
  TextTable::Options options;
  options.header = false;
  if (read_file(path, kMaxTextBytes).find(',') == std::string::npos) options.separator = ' ';
  const TextTable table(path, options);
  GpsRows gps;
  for (int row = 0; row < table.rows(); ++row) {
    if (table.columns(row) < 2) table.fail(row, "not a latitude and a longitude");
    const std::string_view first = table.text(row, 0);
    if (row == 0 && !first.empty() && std::isalpha(static_cast<unsigned char>(first.front()))) continue;
    gps.latitude.push_back(table.number(row, 0));
    gps.longitude.push_back(table.number(row, 1));
    if (std::abs(gps.latitude.back()) > 90 || std::abs(gps.longitude.back()) > 180)
      table.fail(row, "not a latitude and a longitude in degrees");
  }
  if (gps.latitude.empty()) throw Error("has no positions", path);
  forget_impossible({gps.latitude,
                     gps.longitude,
                     {},
                     true,
                     path,
                     "GPS fixes",
                     [](std::size_t row) { return "in row " + std::to_string(row + 1); },
                     false});
  return gps;
}

GpsRows spread(const GpsRows& rows, int frames) {
  const auto known = static_cast<int>(rows.latitude.size());
  if (std::abs(known - frames) * 20 <= frames) {
    GpsRows result = rows;
    result.latitude.resize(static_cast<std::size_t>(frames), kUnknown);
    result.longitude.resize(static_cast<std::size_t>(frames), kUnknown);
    return result;
  }
  GpsRows found;
  std::vector<double> at;
  for (int row = 0; row < known; ++row)
    if (const auto i = static_cast<std::size_t>(row); !std::isnan(rows.latitude[i]))
      found.add(known == 1 ? 0 : static_cast<double>(row) / (known - 1), rows.latitude[i], rows.longitude[i]);
  for (int frame = 0; frame < frames; ++frame)
    at.push_back(frames == 1 ? 0 : static_cast<double>(frame) / (frames - 1));
  return {interpolate(found.times, found.latitude, at, 0), interpolate_longitude(found.times, found.longitude, at, 0)};
}

}  // namespace citylearn
