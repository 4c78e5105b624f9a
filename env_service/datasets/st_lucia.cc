// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>

#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

constexpr double kStLuciaReach = 1.0;  // seconds

/// UQ St Lucia (Warren, McKinnon, He, Upcroft, ACRA 2010): 9.5 km around the university by car, a stereo pair at 30 Hz.
///   <YYMMDD_HHMMSS>_MultiCamera0/cam0_image00000.bmp, cam1_image00000.bmp: raw Bayer (GBRG)
///   <YYMMDD_HHMMSS>_MultiCamera0.log: a header, then fields by blanks: seconds, microseconds of cam0 (0, 1) and of
///     cam1 (5, 6), the pictures' paths (10, 11)
///   <YYMMDD_HHMMSS>_Ins0.log: 12 fields: seconds, microseconds, latitude, longitude, altitude, ...
/// The pictures may have become .png; they are found by the rest of their names. Unsure, for the official page tells
/// little and programs that read the logs disagree: the order of latitude and longitude (here: the one beyond 90 is the
/// longitude), and the Bayer pattern (from users' experience; --st_lucia-raw 0 turns demosaicing off).
class StLucia : public FolderDataset {
 public:
  StLucia(const std::string& folder, const Parameters& parameters)
      : FolderDataset("st_lucia", folder, "<YYMMDD_HHMMSS>_MultiCamera0 folders"),
        camera_(parameters.integer("camera")),
        raw_(parameters.flag("raw")) {}

  std::vector<std::string> names() override {
    std::vector<std::string> found;
    if (is_folder(folder_))
      for (const std::string& name : folders_in(folder_))
        if (has_form(name, "000000_000000_MultiCamera0")) found.push_back(name.substr(0, 13));
    if (found.empty()) not_recognised("<YYMMDD_HHMMSS>_MultiCamera0/ in it");
    return found;
  }

  std::string condition(const std::string&) override { return "day"; }
  Correspondence correspondence() const override { return Correspondence::kGps; }

 private:
  Traversal read(const std::string& name) override {
    const std::string pictures = below(folder_, name + "_MultiCamera0");
    std::map<std::string, std::string> there;  // file by stem
    const std::string prefix = "cam" + std::to_string(camera_) + "_";
    for (const std::string& file : files_in(pictures, image_suffixes()))
      if (file.starts_with(prefix)) there[stem_of(file)] = file;

    const TextTable log(below(folder_, name + "_MultiCamera0.log"), {' ', false});
    std::vector<std::string> paths;
    std::vector<double> times;
    for (int row = 0; row < log.rows(); ++row) {
      if (row == 0 && !starts_with_digit(log.text(0, 0))) continue;
      if (log.columns(row) < 12) log.fail(row, "less than 12 fields");
      std::string file(log.text(row, 10 + camera_));
      file = file.substr(file.find_last_of("/\\") + 1);
      const auto found = there.find(stem_of(file));
      paths.push_back(below(pictures, found == there.end() ? file : found->second));
      times.push_back(log.number(row, 5 * camera_) + log.number(row, 5 * camera_ + 1) * 1e-6);
    }
    std::shared_ptr<Images> images = image_files(paths, folder_);
    if (raw_)
      images = cached(changed(images, "demosaic bilinear gbrg", [](const cv::Mat& picture) {
        cv::Mat mosaic = picture, colours;
        if (picture.channels() == 3) cv::extractChannel(picture, mosaic, 0);
        cv::cvtColor(mosaic, colours, cv::COLOR_BayerGBRG2BGR);
        return colours;
      }));
    Traversal traversal = pictured(name, images, pictures);
    traversal.times = times;
    const std::string ins = below(folder_, name + "_Ins0.log");
    if (is_file(ins)) read_ins(ins, traversal);
    return traversal;
  }

  static bool starts_with_digit(std::string_view text) {
    return !text.empty() && text.front() >= '0' && text.front() <= '9';
  }

  static void read_ins(const std::string& path, Traversal& traversal) {
    const TextTable log(path, {' ', false});
    GpsRows rows;
    rows.log = path;
    for (int row = 0; row < log.rows(); ++row) {
      if (row == 0 && !starts_with_digit(log.text(0, 0))) continue;
      if (log.columns(row) < 4) log.fail(row, "less than 4 fields");
      double north = log.number(row, 2), east = log.number(row, 3);
      if (std::abs(north) > 90) std::swap(north, east);
      if (std::abs(north) > 90 || std::abs(east) > 180) log.fail(row, "not a latitude and a longitude in degrees");
      const double time = log.number(row, 0) + log.number(row, 1) * 1e-6;
      if (rows.falls(time)) log.fail(row, "a time before the one before");
      rows.add(time, north, east);
    }
    if (rows.times.empty()) throw Error("has no positions", path);
    locate(traversal, rows, kStLuciaReach);
  }

  int camera_;
  bool raw_;
};

const DatasetRegistry::Registration st_lucia_registration({
    "st_lucia",
    "UQ St Lucia: 9.5 km around a university campus in Brisbane, stereo",
    {{"camera", "0 or 1 of the stereo pair", 0, 0, 1, true},
     {"raw", "1: pictures are raw Bayer as published; 0: they have colours already", 1, 0, 1, true}},
    open_folder<StLucia>,
    {},
    {{"paper", "Warren, McKinnon, He, Upcroft: Unaided Stereo Vision Based Pose Estimation, ACRA 2010"},
     {"address", "https://michaelwarren.info/docs/datasets/uq-st-lucia-stereo-dataset"},
     {"licence", "none stated; the page asks to cite the paper"},
     {"size", "38 GB"}},
});

}  // namespace
}  // namespace citylearn
