// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>

#include "core/util/text.h"
#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/dataset_io/places.h"
#include "env_service/dataset_io/ranges.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/files/times.h"
#include "env_service/geometry/geometry.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

constexpr double kKittiReach = 0.2;  // seconds; frames and OXTS packets come at 10 Hz

/// "2011-09-26 13:02:25.967790592" as seconds since 1970.
double seconds(const TextTable& table, int row) {
  if (table.columns(row) < 2) table.fail(row, "not a date and a time");
  const std::string date(table.text(row, 0)), time(table.text(row, 1));
  if (!has_form(date, "0000-00-00") || !has_form(time.substr(0, 8), "00:00:00"))
    table.fail(row, "not a date and a time like 2011-09-26 13:02:25.967790592");
  const auto field = [](const std::string& text, std::size_t at, std::size_t size) {
    return std::stoi(text.substr(at, size));
  };
  const std::chrono::year_month_day day{std::chrono::year(field(date, 0, 4)),
                                        std::chrono::month(static_cast<unsigned>(field(date, 5, 2))),
                                        std::chrono::day(static_cast<unsigned>(field(date, 8, 2)))};
  if (!day.ok()) table.fail(row, "no such day");
  double fraction = 0, digit = 0.1;
  for (std::size_t i = 9; i < time.size(); ++i, digit /= 10) {
    if (time[i] < '0' || time[i] > '9') table.fail(row, "not a time");
    fraction += digit * (time[i] - '0');
  }
  const auto days = std::chrono::sys_days(day).time_since_epoch().count();
  return static_cast<double>(days * 86400 + field(time, 0, 2) * 3600 + field(time, 3, 2) * 60 + field(time, 6, 2)) +
         fraction;
}

std::vector<double> read_times(const std::string& path) {
  const TextTable table(path, {' ', false});
  std::vector<double> times;
  for (int row = 0; row < table.rows(); ++row) times.push_back(seconds(table, row));
  return times;
}

std::string padded(int number, int width) {
  std::string digits = std::to_string(number);
  return std::string(static_cast<std::size_t>(std::max(0, width - static_cast<int>(digits.size()))), '0') + digits;
}

/// KITTI. Raw recordings (Geiger, Lenz, Stiller, Urtasun, IJRR 2013), each a traversal named like its folder:
///   [<date>/]<date>_drive_NNNN_sync/image_0C/data/0000000000.png, image_0C/timestamps.txt
///   ..._sync/oxts/timestamps.txt, oxts/data/0000000000.txt: latitude, longitude and 28 more fields
/// and the odometry benchmark (Geiger, Lenz, Urtasun, CVPR 2012), each a traversal named by its two digits:
///   sequences/NN/image_C/000000.png, sequences/NN/times.txt: seconds
///   poses/NN.txt (00 to 10): 12 numbers a row, the 3 x 4 pose of the left camera in that of frame 0 (metres)
/// Positions: raw, along latitude and longitude at the pictures' times; odometry, along the poses' translations, as the
/// benchmark's devkit measures them (trajectoryDistances). OXTS packets that are missing are passed over. _extract
/// folders (unsynchronised) are read like _sync ones.
/// A second camera's picture is put below the first one's, not beside it: they are three times as wide as high, and
/// encoders shrink them to inputs that are at most twice so. Instead of pictures, frames can be the nearest ranges
/// (ranges.h) of the Velodyne's scans, raw velodyne_points/data/0000000000.bin with velodyne_points/timestamps.txt or
/// odometry sequences/NN/velodyne/000000.bin: features that need no encoder. Frames without a scan are then left out.
class Kitti : public FolderDataset {
 public:
  Kitti(const std::string& folder, const Parameters& parameters)
      : FolderDataset("kitti", folder, "sequences/NN or <date>/<date>_drive_NNNN_sync folders"),
        camera_(parameters.integer("camera")),
        second_camera_(parameters.integer("second-camera")),
        ranges_(parameters.integer("ranges")) {
    if (second_camera_ == camera_)
      throw Error("is camera " + std::to_string(camera_) + " already", "--kitti-second-camera", "name another one");
    if (second_camera_ >= 0 && ranges_ > 0)
      throw Error("shows no pictures", "--kitti-ranges", "leave out --kitti-second-camera, or it");
  }

  std::vector<std::string> names() override {
    std::vector<std::string> found;
    for (const auto& [name, path] : recordings()) found.push_back(name);
    if (!found.empty()) return found;
    not_recognised("sequences/NN/" + joined(odometry_sensors()) + " or <date>/<date>_drive_NNNN_sync/" +
                   joined(raw_sensors()) + " in it" +
                   (ranges_ > 0 ? "" : " (--kitti-camera and --kitti-second-camera choose others)"));
  }

  std::string condition(const std::string&) override { return "day"; }
  Correspondence correspondence() const override {
    return first_folder(folder_, {"sequences"}).empty() ? Correspondence::kGps : Correspondence::kDistance;
  }

 private:
  Traversal read(const std::string& name) override {
    return name.size() == 2 ? read_odometry(name) : read_raw(name, recordings().at(name));
  }

  /// Folders of the sensors that are shown, in one of a raw recording.
  std::vector<std::string> raw_sensors() const { return sensors("velodyne_points", "image_0"); }
  /// Likewise of an odometry sequence.
  std::vector<std::string> odometry_sensors() const { return sensors("velodyne", "image_"); }
  std::vector<std::string> sensors(const std::string& laser, const std::string& camera) const {
    if (ranges_ > 0) return {laser};
    std::vector<std::string> folders{camera + std::to_string(camera_)};
    if (second_camera_ >= 0) folders.push_back(camera + std::to_string(second_camera_));
    return folders;
  }

  /// Returns the recordings' folders by name.
  std::map<std::string, std::string> recordings() const {
    std::map<std::string, std::string> found;
    if (!is_folder(folder_)) return found;
    const std::string sequences = below(folder_, "sequences");
    const auto has_all = [](const std::string& folder, const std::vector<std::string>& sensors, const auto& has) {
      return std::all_of(sensors.begin(), sensors.end(),
                         [&](const std::string& name) { return has(below(folder, name)); });
    };
    if (is_folder(sequences))
      for (const std::string& name : folders_in(sequences))
        if (has_form(name, "00") && has_all(below(sequences, name), odometry_sensors(), is_folder))
          found[name] = below(sequences, name);
    const auto look_in = [&](const std::string& folder) {
      for (const std::string& name : folders_in(folder)) {
        const bool form =
            has_form(name, "0000_00_00_drive_0000_sync") || has_form(name, "0000_00_00_drive_0000_extract");
        if (form && has_all(below(folder, name), raw_sensors(), [](const std::string& sensor) {
              return is_folder(below(sensor, "data")) || is_file(below(sensor, "timestamps.txt"));
            }))
          found[name] = below(folder, name);
      }
    };
    look_in(folder_);
    for (const std::string& name : folders_in(folder_))
      if (has_form(name, "0000_00_00")) look_in(below(folder_, name));
    return found;
  }

  Traversal read_raw(const std::string& name, const std::string& drive) const {
    std::vector<std::string> data;
    for (const std::string& sensor : raw_sensors()) data.push_back(below(drive, sensor + "/data"));
    const std::vector<double> times = read_times(below(drive, raw_sensors().front() + "/timestamps.txt"));
    Traversal traversal = seen(name, data, static_cast<int>(times.size()), 10);
    traversal.times = times;
    locate_by_oxts(traversal, drive);
    if (ranges_ > 0) scan(traversal, data.front());
    return traversal;
  }

  /// Returns a traversal with the pictures of the cameras' folders, or without any where the ranges will be shown.
  Traversal seen(const std::string& name, const std::vector<std::string>& folders, int frames, int digits) const {
    if (ranges_ > 0) return unfilled(name, frames, folders.front());
    std::vector<std::shared_ptr<Images>> cameras;
    for (const std::string& folder : folders) {
      std::vector<std::string> paths;
      for (int frame = 0; frame < frames; ++frame) paths.push_back(below(folder, padded(frame, digits) + ".png"));
      cameras.push_back(image_files(std::move(paths), folder_));
    }
    return pictured(name, cameras.size() == 1 ? cameras[0] : stacked(cameras[0], cameras[1]), folders.front());
  }

  /// Fills the frames with the nearest ranges of the scans in `folder` and keeps those that have a scan.
  void scan(Traversal& traversal, const std::string& folder) const {
    const std::vector<std::string> files = files_in(folder, {".bin"});
    // Where scans are missing, their times may be missing too: as many times as scans belong to one another in turn.
    const bool in_turn = static_cast<int>(files.size()) == traversal.frames;
    std::vector<int> scanned;
    std::vector<float> ranges;
    for (const std::string& file : files) {
      const long frame = in_turn ? static_cast<long>(scanned.size()) : last_number(stem_of(file));
      if (frame < 0 || frame >= traversal.frames)
        throw Error("is the scan of no frame: the recording has " + std::to_string(traversal.frames) + " times",
                    below(folder, file));
      const std::vector<float> nearest = nearest_ranges(below(folder, file), ranges_);
      ranges.insert(ranges.end(), nearest.begin(), nearest.end());
      scanned.push_back(static_cast<int>(frame));
    }
    if (scanned.size() < 2) throw Error("has " + std::to_string(scanned.size()) + " scans, a route needs two", folder);
    if (!in_turn)
      spdlog::warn("{}: {} of {} frames have no scan and are left out", folder,
                   traversal.frames - static_cast<int>(scanned.size()), traversal.frames);
    traversal.keep(scanned);
    traversal.dimension = ranges_;
    traversal.features = std::move(ranges);
  }

  static void locate_by_oxts(Traversal& traversal, const std::string& drive) {
    const std::string oxts = below(drive, "oxts");
    if (!is_folder(oxts)) return;
    GpsRows rows;
    rows.log = oxts;
    std::vector<std::string> missing;
    const std::vector<double> packets = read_times(below(oxts, "timestamps.txt"));
    for (std::size_t packet = 0; packet < packets.size(); ++packet) {
      if (rows.falls(packets[packet])) continue;  // some _extract drives hold late ones
      const std::string path = below(oxts, "data/" + padded(static_cast<int>(packet), 10) + ".txt");
      if (!is_file(path)) {
        missing.push_back(path);
        continue;
      }
      const TextTable table(path, {' ', false});
      if (table.rows() != 1 || table.columns(0) < 2) throw Error("is not an OXTS packet of one line", path);
      rows.add(packets[packet], table.number(0, 0), table.number(0, 1),
               table.columns(0) > 2 ? table.number(0, 2) : kUnknown);
    }
    if (!missing.empty())
      spdlog::warn("{}: no such packet ({} of {} are missing); places are interpolated between the others",
                   missing.front(), missing.size(), packets.size());
    locate(traversal, rows, kKittiReach);
  }

  Traversal read_odometry(const std::string& name) const {
    const std::string sequence = below(folder_, "sequences/" + name);
    std::vector<std::string> data;
    for (const std::string& sensor : odometry_sensors()) data.push_back(below(sequence, sensor));
    const TextTable clock(below(sequence, "times.txt"), {' ', false});
    Traversal traversal = seen(name, data, clock.rows(), 6);
    for (int frame = 0; frame < clock.rows(); ++frame) traversal.times.push_back(clock.number(frame, 0));
    locate_by_poses(traversal);
    if (ranges_ > 0) scan(traversal, data.front());
    return traversal;
  }

  void locate_by_poses(Traversal& traversal) const {
    const std::string& name = traversal.name;
    const std::string path = first_file(folder_, {"poses/" + name + ".txt", "sequences/" + name + "/poses.txt"});
    if (path.empty()) return;  // sequences 11 to 21 have none
    const TextTable poses(path, {' ', false});
    if (poses.rows() != traversal.frames)
      throw Error("has " + std::to_string(poses.rows()) + " poses, times.txt lists " +
                      std::to_string(traversal.frames) + " frames",
                  path);
    std::vector<double> x, y, z;
    for (int frame = 0; frame < traversal.frames; ++frame) {
      if (poses.columns(frame) != 12) poses.fail(frame, "not the 12 numbers of a pose");
      x.push_back(poses.number(frame, 3));
      y.push_back(poses.number(frame, 7));
      z.push_back(poses.number(frame, 11));
    }
    forget_impossible({x, z, traversal.times, false, path, "poses",
                       [&poses](std::size_t row) { return "in " + poses.place(static_cast<int>(row)); }, false});
    traversal.positions = metres_along_plane(x, y, z);
    for (double& down : y) down = -down;
    traversal.x = std::move(x);
    traversal.y = std::move(z);
    traversal.height = std::move(y);
  }

  const int camera_;
  const int second_camera_;  ///< -1: none
  const int ranges_;         ///< bins of a scan; 0: pictures are shown
};

const DatasetRegistry::Registration kitti_registration({
    "kitti",
    "KITTI: drives around Karlsruhe, raw recordings and the odometry benchmark",
    {{"camera", "0 left grey, 1 right grey, 2 left colour, 3 right colour", 2, 0, 3, true},
     {"second-camera", "Its picture is put below the camera's; -1: none", -1, -1, 3, true},
     {"ranges", "Show no pictures but the nearest range in so many bins of the Velodyne's turn, metres; 0: pictures", 0,
      0, 2048, true}},
    open_folder<Kitti>,
    {},
    {{"paper", "Geiger, Lenz, Stiller, Urtasun: Vision meets Robotics: The KITTI Dataset, IJRR 2013"},
     {"address", "https://www.cvlibs.net/datasets/kitti"},
     {"licence", "CC BY-NC-SA 3.0"},
     {"size", "odometry in colour 65 GB, in grey 22 GB; raw 180 GB"}},
});

}  // namespace
}  // namespace citylearn
