// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <set>

#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/geometry/geometry.h"
#include "env_service/images/image_sources.h"
#include "env_service/traversal/places.h"

namespace citylearn {
namespace {

/// A camera of the car: its folder, the file of its times, and the colours of its raw pixels.
struct Camera {
  const char* folder;
  const char* timestamps;
  const char* pattern;  // the first two pixels of the first row, then of the second
  int demosaic;
};
// Bumblebee XB3: GBRG; Grasshopper2: RGGB (robotcar-dataset-sdk, python/image.py, BAYER_STEREO and BAYER_MONO).
constexpr std::array<Camera, 6> kCameras{{
    {"stereo/centre", "stereo.timestamps", "gbrg", cv::COLOR_BayerGBRG2BGR},
    {"stereo/left", "stereo.timestamps", "gbrg", cv::COLOR_BayerGBRG2BGR},
    {"stereo/right", "stereo.timestamps", "gbrg", cv::COLOR_BayerGBRG2BGR},
    {"mono_left", "mono_left.timestamps", "rggb", cv::COLOR_BayerRGGB2BGR},
    {"mono_right", "mono_right.timestamps", "rggb", cv::COLOR_BayerRGGB2BGR},
    {"mono_rear", "mono_rear.timestamps", "rggb", cv::COLOR_BayerRGGB2BGR},
}};

constexpr char kForm[] = "0000-00-00-00-00-00";
constexpr char kMicrosecondsForm[] = "0000000000000000";
constexpr double kMicroseconds = 1e-6;
/// A frame has a position when a measurement is as near, in seconds: the slowest (GPS) comes at 5 Hz.
constexpr double kRobotCarReach = 1.0;

/// The tags of the SDK's tags/ that describe how a place looks, in the order in which a condition names them; the
/// others describe the drive ("detour", "no-gps").
constexpr std::array<const char*, 9> kAppearance = {"sun",  "clouds", "overcast", "partial", "rain",
                                                    "snow", "dusk",   "dawn",     "night"};

/// The Oxford RobotCar dataset (Maddern, Pascoe, Linegar, Newman, IJRR 2017), as its archives unpack into one folder:
///   <traversal>/<camera folder>/<microseconds since 1970>.png, raw Bayer pictures of 8 bits
///   <traversal>/<camera>.timestamps: microseconds and the number of the archive's chunk, a row a picture
///   <traversal>/gps/ins.csv, gps/gps.csv, vo/vo.csv, and since 2020 rtk.csv: where the car was
///   tags/<traversal>.yaml (from the SDK): "- sun" ..., lines of conditions
/// A chunk counts when at least half of its pictures are there; the others were not fetched. Positions: the way
/// along northing and easting of RTK, else INS, else GPS; else the lengths of visual odometry's steps added up, which
/// drift. All rows of INS count, whatever their ins_status, as in the SDK.
/// Unsure: where rtk.csv lies after unpacking (looked for beside gps/ and in it, and in rtk/<traversal>/).
class OxfordRobotcar : public FolderDataset {
 public:
  OxfordRobotcar(const std::string& folder, const Parameters& parameters)
      : FolderDataset("oxford_robotcar", folder, "<YYYY-MM-DD-HH-MM-SS> folders"),
        camera_(kCameras.at(static_cast<std::size_t>(parameters.integer("camera")))),
        raw_(parameters.flag("raw")),
        reduce_(parameters.integer("reduce")) {}

  std::vector<std::string> names() override {
    std::vector<std::string> found;
    if (is_folder(folder_))
      for (const std::string& name : folders_in(folder_))
        if (has_form(name, kForm) && is_folder(below(folder_, name + "/" + camera_.folder))) found.push_back(name);
    if (found.empty()) not_recognised(std::string("<YYYY-MM-DD-HH-MM-SS>/") + camera_.folder + "/ in it");
    return found;
  }

  std::string condition(const std::string& name) override {
    const std::string path = first_file(folder_, {"tags/" + name + ".yaml", name + "/tags/" + name + ".yaml",
                                                  name + "/" + name + ".yaml", name + ".yaml"});
    if (path.empty()) return "";
    const TextTable tags(path, {' ', false});
    std::set<std::string> found;
    for (int row = 0; row < tags.rows(); ++row) found.emplace(tags.text(row, tags.columns(row) > 1 ? 1 : 0));
    std::string condition;
    for (const std::string tag : kAppearance)
      if (found.contains(tag)) condition += (condition.empty() ? "" : "+") + tag;
    return condition;
  }

  Correspondence correspondence() const override { return Correspondence::kGps; }

 private:
  Traversal read(const std::string& name) override {
    const std::string drive = below(folder_, name), pictures = below(drive, camera_.folder);
    std::vector<std::string> paths;
    std::vector<double> times;
    for (const std::string& stamp : picture_stamps(drive, pictures)) {
      paths.push_back(below(pictures, stamp + ".png"));
      times.push_back(std::stod(stamp) * kMicroseconds);
    }
    std::shared_ptr<Images> images = image_files(paths, folder_);
    if (raw_ || reduce_ > 1) {
      std::string recipe = raw_ ? std::string("demosaic bilinear ") + camera_.pattern : "as it is";
      if (reduce_ > 1) recipe += ", reduced " + std::to_string(reduce_) + " times";
      images = cached(
          changed(images, recipe, [raw = raw_, code = camera_.demosaic, factor = reduce_](const cv::Mat& picture) {
            cv::Mat mosaic = picture, colours = picture, small;
            if (raw && picture.channels() == 3) cv::extractChannel(picture, mosaic, 0);
            if (raw) cv::cvtColor(mosaic, colours, code);
            if (factor == 1) return colours;
            const cv::Size size(std::max(1, colours.cols / factor), std::max(1, colours.rows / factor));
            cv::resize(colours, small, size, 0, 0, cv::INTER_AREA);
            return small;
          }));
    }
    Traversal traversal = pictured(name, images, pictures);
    traversal.times = times;
    find_positions(drive, name, traversal);
    return traversal;
  }

  /// Microseconds of the frames, as written: those of the chunks that were fetched, or the files' own without a
  /// .timestamps.
  std::vector<std::string> picture_stamps(const std::string& drive, const std::string& pictures) const {
    std::set<std::string> there;
    for (const std::string& file : files_in(pictures, {".png"}))
      if (has_form(stem_of(file), kMicrosecondsForm)) there.insert(stem_of(file));
    const std::string path = first_file(drive, {camera_.timestamps});
    if (path.empty()) return {there.begin(), there.end()};

    const TextTable table(path, {' ', false});
    std::vector<std::string> all, stamps;
    std::map<std::string, std::pair<int, int>> chunks;  // pictures that are there, pictures in all
    const auto chunk = [&](int row) { return std::string(table.columns(row) > 1 ? table.text(row, 1) : ""); };
    for (int row = 0; row < table.rows(); ++row) {
      const std::string stamp(table.text(row, 0));
      if (!has_form(stamp, kMicrosecondsForm)) table.fail(row, "not a time of 16 digits (microseconds)");
      if (!all.empty() && stamp <= all.back()) table.fail(row, "a time that is not later than the one before");
      all.push_back(stamp);
      auto& [present, wanted] = chunks[chunk(row)];
      ++wanted;
      present += there.contains(stamp);
    }
    for (int row = 0; row < table.rows(); ++row) {
      const auto& [present, wanted] = chunks[chunk(row)];
      const std::string& stamp = all[static_cast<std::size_t>(row)];
      if (2 * present >= wanted || there.contains(stamp)) stamps.push_back(stamp);
    }
    return stamps;
  }

  void find_positions(const std::string& drive, const std::string& name, Traversal& traversal) const {
    const std::string measured =
        first_file(drive, {"rtk.csv", "gps/rtk.csv", "../rtk/" + name + "/rtk.csv", "gps/ins.csv", "gps/gps.csv"});
    if (!measured.empty()) return read_positions(measured, traversal);
    const std::string odometry = first_file(drive, {"vo/vo.csv"});
    if (!odometry.empty()) read_odometry(odometry, traversal);
  }

  /// A row of a table of measured positions.
  struct Fix {
    int row;
    double time, latitude, longitude, northing, easting;
  };

  static void read_positions(const std::string& path, Traversal& traversal) {
    const TextTable table(path, {});
    std::vector<Fix> fixes;
    for (int row = 0; row < table.rows(); ++row) {
      const double north = table.number(row, "latitude"), east = table.number(row, "longitude");
      if (north == 0 && east == 0) continue;  // no solution yet
      fixes.push_back({row, table.number(row, "timestamp") * kMicroseconds, north, east, table.number(row, "northing"),
                       table.number(row, "easting")});
    }
    const auto earlier = [](const Fix& a, const Fix& b) { return a.time < b.time; };
    if (const auto late = std::is_sorted_until(fixes.begin(), fixes.end(), earlier); late != fixes.end()) {
      spdlog::warn("{}: its time is before that of the row before; rows are sorted by time", table.place(late->row));
      std::stable_sort(fixes.begin(), fixes.end(), earlier);
    }
    const auto all = [&fixes](double Fix::*value) {
      std::vector<double> values;
      for (const Fix& fix : fixes) values.push_back(fix.*value);
      return values;
    };
    std::vector<double> north = all(&Fix::latitude), east = all(&Fix::longitude);
    forget_impossible({north, east, all(&Fix::time), true, path, "GPS fixes",
                       [&](std::size_t i) { return "in " + table.place(fixes[i].row); }, false});
    std::erase_if(fixes, [&, i = std::size_t{0}](const Fix& fix) mutable { return north[i++] != fix.latitude; });
    if (fixes.empty()) return;
    const std::vector<double> times = all(&Fix::time);
    const auto at = [&](double Fix::*value) { return interpolate(times, all(value), traversal.times, kRobotCarReach); };
    traversal.latitude = at(&Fix::latitude);
    traversal.longitude = interpolate_longitude(times, all(&Fix::longitude), traversal.times, kRobotCarReach);
    traversal.positions = metres_along_plane(at(&Fix::easting), at(&Fix::northing));
  }

  /// The way is as long as the steps are, whatever their directions.
  static void read_odometry(const std::string& path, Traversal& traversal) {
    const TextTable table(path, {});
    std::vector<double> times, metres;
    for (int row = 0; row < table.rows(); ++row) {
      // The SDK takes the first column for when the step ends; the columns' names would have it the other way.
      const double a = table.number(row, "source_timestamp"), b = table.number(row, "destination_timestamp");
      if (times.empty()) {
        times.push_back(std::min(a, b) * kMicroseconds);
        metres.push_back(0);
      }
      const double end = std::max(a, b) * kMicroseconds;
      if (end < times.back()) table.fail(row, "a time before the one before");
      times.push_back(end);
      metres.push_back(metres.back() +
                       std::hypot(table.number(row, "x"), table.number(row, "y"), table.number(row, "z")));
    }
    if (times.empty()) return;
    const std::vector<double> along = interpolate(times, metres, traversal.times, kRobotCarReach);
    traversal.positions.assign(along.begin(), along.end());
  }

  Camera camera_;
  bool raw_;
  int reduce_;
};

const DatasetRegistry::Registration oxford_robotcar_registration({
    "oxford_robotcar",
    "Oxford RobotCar: drives of one route through Oxford over a year, in all weather",
    {{"camera", "0 stereo centre, 1 stereo left, 2 stereo right, 3 mono left, 4 mono right, 5 mono rear", 0, 0, 5,
      true},
     {"raw", "1: pictures are raw Bayer as published; 0: they have colours already", 1, 0, 1, true},
     {"reduce", "factor by which the width and height of pictures are reduced", 1, 1, 16, true}},
    open_folder<OxfordRobotcar>,
    {},
    {{"paper", "Maddern, Pascoe, Linegar, Newman: 1 Year, 1000 km: The Oxford RobotCar Dataset, IJRR 2017"},
     {"address", "https://robotcar-dataset.robots.ox.ac.uk"},
     {"licence", "CC BY-NC-SA 4.0"},
     {"size", "23 TB in all, each sensor of each drive in archives of up to 5 GB"}},
});

}  // namespace
}  // namespace citylearn
