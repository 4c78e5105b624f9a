// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/folder_dataset.h"

#include <spdlog/spdlog.h>

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
constexpr double kFastest = 100;       // metres a second; no train or car of a dataset is faster
constexpr double kFixError = 1000;     // metres that a fix may be off, as the first ones behind a tunnel are
constexpr std::size_t kBelieved = 10;  // a stretch of at least 1/10 of a log is believed wherever it lies

/// Whether a vehicle can have come from one fix to a later one.
bool reachable(const GpsRows& rows, std::size_t from, std::size_t to) {
  return metres_between(rows.latitude[from], rows.longitude[from], rows.latitude[to], rows.longitude[to]) <=
         kFixError + kFastest * (rows.times[to] - rows.times[from]);
}

/// Returns the fixes without short stretches that can be reached neither from those before nor lead to those after.
GpsRows without_jumps(const GpsRows& rows) {
  const std::size_t count = rows.times.size();
  std::vector<std::size_t> begins;  // of stretches without a jump
  std::size_t longest = 0;
  for (std::size_t row = 0; row < count; ++row)
    if (row == 0 || !reachable(rows, row - 1, row)) begins.push_back(row);
  if (begins.size() < 2) return rows;
  begins.push_back(count);
  for (std::size_t i = 0; i + 1 < begins.size(); ++i) longest = std::max(longest, begins[i + 1] - begins[i]);
  const auto believed = [&](std::size_t i) {
    const std::size_t size = begins[i + 1] - begins[i];
    return size == longest || size * kBelieved >= count;
  };
  GpsRows kept;
  kept.log = rows.log;
  std::size_t last = count, first_ignored = count;  // count: none
  std::size_t next = 0;                             // stretch that is believed
  for (std::size_t i = 0; i + 1 < begins.size(); ++i) {
    next = std::max(next, i);
    while (next + 1 < begins.size() && !believed(next)) ++next;
    const bool leads_on = next + 1 < begins.size() && (next == i || reachable(rows, begins[i + 1] - 1, begins[next]));
    if (!leads_on && (last == count || !reachable(rows, last, begins[i]))) {
      first_ignored = std::min(first_ignored, begins[i]);
      continue;
    }
    last = begins[i + 1] - 1;
    for (std::size_t row = begins[i]; row <= last; ++row)
      kept.add(rows.times[row], rows.latitude[row], rows.longitude[row]);
  }
  if (first_ignored == count) return rows;
  const std::size_t other = first_ignored == 0 ? begins[1] : first_ignored;  // where it jumps
  spdlog::warn(
      "{}: {} of {} GPS fixes are ignored, the first {:.0f} s into the log: {:.1f} km in {:.1f} s is too fast",
      rows.log, count - kept.times.size(), count, rows.times[first_ignored] - rows.times[0],
      metres_between(rows.latitude[other - 1], rows.longitude[other - 1], rows.latitude[other], rows.longitude[other]) /
          1000,
      rows.times[other] - rows.times[other - 1]);
  return kept;
}

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
  const GpsRows kept = without_jumps(rows);
  locate(traversal, interpolate(kept.times, kept.latitude, traversal.times, reach),
         interpolate(kept.times, kept.longitude, traversal.times, reach));
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
