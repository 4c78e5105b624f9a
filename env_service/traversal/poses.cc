// SPDX-License-Identifier: Apache-2.0
#include "poses.h"

#include <spdlog/spdlog.h>

#include <cmath>
#include <limits>
#include <unordered_map>

#include "core/util/error.h"
#include "core/util/text.h"
#include "core/wire/messages.h"
#include "env_service/files/text_table.h"
#include "env_service/geometry/geometry.h"
#include "places.h"

namespace citylearn {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

const std::vector<std::string> kHeightColumns{"z", "height", "alt", "altitude", "ele", "elevation"};

int frame_number(const TextTable& table, int row, const std::string& column) {
  const double number = table.number(row, column);
  if (number != std::floor(number) || number < 0 || number >= msg::MAX_FRAMES)
    table.fail(row, "not the number of a frame in column '" + column + "'", "frames begin with 0");
  return static_cast<int>(number);
}

std::vector<int> frames_of(const TextTable& table, const Traversal& traversal) {
  std::unordered_map<std::string, int> files;
  const bool by_file = !table.has("frame") && table.has("file");
  if (by_file) {
    if (!traversal.images) throw Error("column 'file' is for pictures", table.path(), "name rows by a column 'frame'");
    for (int frame = 0; frame < traversal.frames; ++frame) {
      const std::string name = traversal.images->name(frame);
      files.emplace(name.substr(name.rfind('/') + 1), frame);
    }
  }
  std::vector<int> frames;
  std::vector<bool> seen(static_cast<std::size_t>(traversal.frames));
  for (int row = 0; row < table.rows(); ++row) {
    int frame = row;
    if (by_file) {
      const std::string text(table.text(row, "file"));
      const auto found = files.find(text.substr(text.rfind('/') + 1));
      if (found == files.end()) table.fail(row, "no picture of this name in " + traversal.name);
      frame = found->second;
    } else if (table.has("frame")) {
      frame = frame_number(table, row, "frame");
    }
    if (frame >= traversal.frames)
      table.fail(row, "frame " + std::to_string(frame) + " is beyond " + traversal.name + ", which has " +
                          std::to_string(traversal.frames) + " frames");
    if (seen[static_cast<std::size_t>(frame)]) table.fail(row, "a second row for frame " + std::to_string(frame));
    seen[static_cast<std::size_t>(frame)] = true;
    frames.push_back(frame);
  }
  return frames;
}

}  // namespace

void read_poses(const std::string& path, Traversal& traversal) {
  const TextTable table(path, {});
  const std::vector<int> frames = frames_of(table, traversal);
  const auto number = [&](int row, const std::string& name) {
    const std::string_view text = table.text(row, name);
    return text.empty() || text == "nan" || text == "NaN" ? kNan : table.number(row, name);
  };
  const auto column = [&](const std::string& name) {
    std::vector<double> values(static_cast<std::size_t>(traversal.frames), kNan);
    for (int row = 0; row < table.rows(); ++row)
      values[static_cast<std::size_t>(frames[static_cast<std::size_t>(row)])] = number(row, name);
    return values;
  };
  if (table.has("time")) traversal.times = column("time");
  for (std::size_t i = 1; i < traversal.times.size(); ++i)
    if (traversal.times[i] < traversal.times[i - 1])
      throw Error("the time of frame " + std::to_string(i) + " is before that of frame " + std::to_string(i - 1), path,
                  "write rows in the order of frames, or name frames in a column 'frame'");
  if (table.has("lat") || table.has("lon")) {
    for (int row = 0; row < table.rows(); ++row)
      if (std::abs(number(row, "lat")) > 90 || std::abs(number(row, "lon")) > 180)
        table.fail(row, "not a latitude and a longitude in degrees", "leave both empty where there was no fix");
    traversal.latitude = column("lat");
    traversal.longitude = column("lon");
    traversal.positions = metres_along(traversal.latitude, traversal.longitude);
  }
  for (const std::string& name : kHeightColumns) {
    if (!traversal.height.empty() || !table.has(name)) continue;
    for (int row = 0; row < table.rows(); ++row)
      if (const double z = number(row, name); !std::isnan(z) && !is_height(z))
        table.fail(row, "not a height in metres", "leave " + name + " empty where it is unknown");
    traversal.height = column(name);
    fill_heights(traversal.height);
  }
  const bool in_plane = table.has("x") || table.has("y");
  if (in_plane) {
    traversal.x = column("x");
    traversal.y = column("y");
  }
  if (table.has("metres")) {
    const std::vector<double> metres = column("metres");
    traversal.positions.assign(metres.begin(), metres.end());
  } else if (in_plane) {
    const std::vector<double>& z = traversal.height;
    if (!z.empty())
      forget_impossible({traversal.x, traversal.y, traversal.times, false, path, "places",
                         [](std::size_t row) { return "frame " + std::to_string(row); }, false});
    traversal.positions = metres_along_plane(traversal.x, traversal.y, z);
  } else if (traversal.latitude.empty()) {
    throw Error("no column gives places, there are: " + joined(table.unused(), printable), path,
                "its header needs lat,lon or x,y or metres");
  }
  if (!table.has("frame") && !table.has("file") && table.rows() < traversal.frames)
    throw Error("has " + std::to_string(table.rows()) + " rows, " + traversal.name + " has " +
                    std::to_string(traversal.frames) + " frames",
                table.path(), "write a row for each frame, or name frames in a column 'frame'");
  if (!table.unused().empty())
    spdlog::warn("{}: columns that are not read: {}", path, joined(table.unused(), printable));
}

std::vector<std::pair<int, int>> read_matches(const std::string& path, const std::string& a, const std::string& b) {
  const TextTable table(path, {});
  std::vector<std::pair<int, int>> pairs;
  for (const std::string& name : {a, b})
    if (!table.has(name))
      throw Error("no column '" + name + "'", path, "its header names traversals, its rows hold their frames");
  for (int row = 0; row < table.rows(); ++row)
    pairs.emplace_back(frame_number(table, row, a), frame_number(table, row, b));
  return pairs;
}

}  // namespace citylearn
