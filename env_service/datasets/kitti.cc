// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "core/util/text.h"
#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/files/times.h"
#include "env_service/geometry/geometry.h"
#include "env_service/traversal/places.h"

namespace citylearn {
namespace {

constexpr double kKittiReach = 0.2;  // seconds; frames and OXTS packets come at 10 Hz

/// Returns the seconds since 1970 of each row, "2011-09-26 13:02:25.967790592".
std::vector<double> read_times(const std::string& path) {
  const TextTable table(path, {' ', false});
  std::vector<double> times;
  for (int row = 0; row < table.rows(); ++row) {
    times.push_back(read_moment(std::string(table.text(row, 0)) + "T" +
                                std::string(table.columns(row) > 1 ? table.text(row, 1) : ""))
                        .seconds);
    if (std::isnan(times.back())) table.fail(row, "not a date and a time like 2011-09-26 13:02:25.967790592");
  }
  return times;
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
class Kitti : public FolderDataset {
 public:
  Kitti(const std::string& folder, const Parameters& parameters)
      : FolderDataset("kitti", folder, "sequences/NN or <date>/<date>_drive_NNNN_sync folders"),
        camera_(std::to_string(parameters.integer("camera"))) {}

  std::vector<std::string> names() override {
    return names_of(recordings(), "sequences/NN/image_" + camera_ + " or <date>/<date>_drive_NNNN_sync/image_0" +
                                      camera_ + " in it (--kitti-camera chooses another)");
  }

  std::string condition(const std::string&) override { return "day"; }
  Correspondence correspondence() const override {
    return first_folder(folder_, {"sequences"}).empty() ? Correspondence::kGps : Correspondence::kDistance;
  }

 private:
  Traversal read(const std::string& name) override {
    return name.size() == 2 ? read_odometry(name) : read_raw(name, recordings().at(name));
  }

  /// Returns the recordings' folders by name.
  std::map<std::string, std::string> recordings() const {
    std::map<std::string, std::string> found;
    if (!is_folder(folder_)) return found;
    const std::string sequences = below(folder_, "sequences");
    if (is_folder(sequences))
      for (const std::string& name : folders_in(sequences))
        if (has_form(name, "00") && is_folder(below(sequences, name + "/image_" + camera_)))
          found[name] = below(sequences, name);
    const auto look_in = [&](const std::string& folder) {
      for (const std::string& name : folders_in(folder)) {
        const bool form =
            has_form(name, "0000_00_00_drive_0000_sync") || has_form(name, "0000_00_00_drive_0000_extract");
        const std::string pictures = below(folder, name + "/image_0" + camera_);
        if (form && (is_folder(below(pictures, "data")) || is_file(below(pictures, "timestamps.txt"))))
          found[name] = below(folder, name);
      }
    };
    look_in(folder_);
    for (const std::string& name : folders_in(folder_))
      if (has_form(name, "0000_00_00")) look_in(below(folder_, name));
    return found;
  }

  Traversal read_raw(const std::string& name, const std::string& drive) const {
    const std::string pictures = below(drive, "image_0" + camera_);
    const std::vector<double> times = read_times(below(pictures, "timestamps.txt"));
    Traversal traversal = seen(name, below(pictures, "data"), static_cast<int>(times.size()), 10);
    traversal.times = times;
    locate_by_oxts(traversal, drive);
    return traversal;
  }

  /// Returns a traversal with the pictures of a folder, named by numbers of so many digits.
  Traversal seen(const std::string& name, const std::string& folder, int frames, int digits) const {
    std::vector<std::string> paths;
    for (int frame = 0; frame < frames; ++frame)
      paths.push_back(below(folder, fmt::format("{:0{}}.png", frame, digits)));
    return pictured(name, std::move(paths), folder);
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
      const std::string path = below(oxts, fmt::format("data/{:010}.txt", packet));
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
    const TextTable clock(below(sequence, "times.txt"), {' ', false});
    Traversal traversal = seen(name, below(sequence, "image_" + camera_), clock.rows(), 6);
    for (int frame = 0; frame < clock.rows(); ++frame) traversal.times.push_back(clock.number(frame, 0));
    locate_by_poses(traversal);
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

  const std::string camera_;  ///< its digit
};

const DatasetRegistry::Registration kitti_registration({
    "kitti",
    "KITTI: drives around Karlsruhe, raw recordings and the odometry benchmark",
    {{"camera", "0 left grey, 1 right grey, 2 left colour, 3 right colour", 2, 0, 3, true}},
    open_folder<Kitti>,
    {},
    {{"paper", "Geiger, Lenz, Stiller, Urtasun: Vision meets Robotics: The KITTI Dataset, IJRR 2013"},
     {"address", "https://www.cvlibs.net/datasets/kitti"},
     {"licence", "CC BY-NC-SA 3.0"},
     {"size", "odometry in colour 65 GB, in grey 22 GB; raw 180 GB"}},
});

}  // namespace
}  // namespace citylearn
