// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/folder_dataset.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>

#include "core/files/files.h"
#include "core/wire/messages.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/geometry/geometry.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

}  // namespace

FolderDataset::FolderDataset(const std::string& dataset, const std::string& folder, const std::string& contents)
    : dataset_(dataset), folder_(folder) {
  if (folder.empty()) throw Error("needs a folder of " + contents, "dataset " + dataset, "give it with --data DIR");
}

Traversal FolderDataset::load(const std::string& name) {
  require_known(name);
  Traversal traversal = read(name);
  traversal.condition = condition(name);
  if (std::any_of(traversal.positions.begin(), traversal.positions.end(), [](float x) { return std::isinf(x); }))
    throw Error("traversal '" + name + "' has places that are too far apart to measure", folder_, "mend its positions");
  return traversal;
}

void FolderDataset::require_known(const std::string& name) {
  const std::vector<std::string> known = names();
  if (std::find(known.begin(), known.end(), name) == known.end()) throw unknown_traversal(name, folder_, known);
}

void FolderDataset::not_recognised(const std::string& missing) const {
  throw Error("is not the dataset " + dataset_ + ": there is no " + missing, folder_,
              is_folder(folder_) ? "--data names the folder that holds it" : "there is no such folder");
}

Traversal FolderDataset::pictured(const std::string& name, std::shared_ptr<Images> images,
                                  const std::string& where) const {
  const int frames = images->frames();
  const std::string count = "has " + (frames == 1 ? "only one frame" : std::to_string(frames) + " frames");
  if (frames < 2) throw Error(count + ", a route needs two", where);
  if (frames > static_cast<int>(msg::MAX_FRAMES))
    throw Error(count + ", more than " + std::to_string(msg::MAX_FRAMES), where);
  if (name.size() > 64) throw Error("the name of a traversal may have 64 characters", where);
  Traversal traversal;
  traversal.dataset = dataset_;
  traversal.name = name;
  traversal.frames = frames;
  traversal.images = std::move(images);
  traversal.positions.assign(static_cast<std::size_t>(frames), std::numeric_limits<float>::quiet_NaN());
  return traversal;
}

Traversal FolderDataset::pictured(const std::string& name, std::vector<std::string> paths,
                                  const std::string& where) const {
  return pictured(name, image_files(std::move(paths), folder_), where);
}

Traversal FolderDataset::filmed(const std::string& name, const std::string& video) const {
  double rate = 0;
  Traversal traversal = pictured(name, video_frames(video, folder_, &rate), video);
  for (int frame = 0; rate > 0 && frame < traversal.frames; ++frame) traversal.times.push_back(frame / rate);
  return traversal;
}

Traversal FolderDataset::recorded(const std::string& name, const std::string& path) const {
  if (!is_folder(path)) return filmed(name, path);
  std::vector<std::string> paths;
  for (const NumberedFile& file : numbered_files(path, image_suffixes())) paths.push_back(file.path);
  return pictured(name, std::move(paths), path);
}

void locate(Traversal& traversal, std::vector<double> latitude, std::vector<double> longitude) {
  traversal.positions = metres_along(latitude, longitude);
  traversal.latitude = std::move(latitude);
  traversal.longitude = std::move(longitude);
}

void GpsRows::add(double time, double north, double east) {
  times.push_back(time);
  latitude.push_back(north);
  longitude.push_back(east);
}

void locate(Traversal& traversal, const GpsRows& rows, double reach) {
  locate(traversal, interpolate(rows.times, rows.latitude, traversal.times, reach),
         interpolate(rows.times, rows.longitude, traversal.times, reach));
}

GpsRows read_gps_rows(const std::string& path) {
  TextTable::Options options;
  options.header = false;
  if (read_file(path, kLargestText).find(',') == std::string::npos) options.separator = ' ';
  const TextTable table(path, options);
  GpsRows gps;
  for (int row = 0; row < table.rows(); ++row) {
    if (table.columns(row) < 2) table.fail(row, "not a latitude and a longitude");
    const std::string_view first = table.text(row, 0);
    if (row == 0 && !first.empty() && std::isalpha(static_cast<unsigned char>(first.front()))) continue;
    double latitude = table.number(row, 0), longitude = table.number(row, 1);
    if (std::abs(latitude) > 90 || std::abs(longitude) > 180)
      table.fail(row, "not a latitude and a longitude in degrees");
    if (latitude == 0 && longitude == 0) latitude = longitude = kUnknown;
    gps.latitude.push_back(latitude);
    gps.longitude.push_back(longitude);
  }
  if (gps.latitude.empty()) throw Error("has no positions", path);
  return gps;
}

GpsRows spread(const GpsRows& rows, int frames) {
  const auto known = static_cast<int>(rows.latitude.size());
  const std::vector<double> unknown(static_cast<std::size_t>(frames), kUnknown);
  GpsRows result{unknown, unknown};
  if (std::abs(known - frames) * 20 <= frames) {
    const int count = std::min(known, frames);
    std::copy_n(rows.latitude.begin(), count, result.latitude.begin());
    std::copy_n(rows.longitude.begin(), count, result.longitude.begin());
    return result;
  }
  std::vector<double> times, latitude, longitude, at;
  for (int row = 0; row < known; ++row) {
    const auto i = static_cast<std::size_t>(row);
    if (std::isnan(rows.latitude[i])) continue;
    times.push_back(known == 1 ? 0 : static_cast<double>(row) / (known - 1));
    latitude.push_back(rows.latitude[i]);
    longitude.push_back(rows.longitude[i]);
  }
  for (int frame = 0; frame < frames; ++frame)
    at.push_back(frames == 1 ? 0 : static_cast<double>(frame) / (frames - 1));
  if (times.empty()) return result;
  return {interpolate(times, latitude, at, 0), interpolate(times, longitude, at, 0)};
}

}  // namespace citylearn
