// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"

namespace citylearn {
namespace {

/// St Lucia Multiple Times of Day (Glover, Maddern, Milford, Wyeth, ICRA 2010): one route driven ten times, at five
/// times of the day, twice. As its archives unpack into one folder:
///   <ddmmyy_hhmm>/webcam_video.avi: 640 x 480 at 15 Hz
///   <ddmmyy_hhmm>/fGPS.txt: "latitude,longitude" in degrees, a row a frame; the southern latitude without its minus
/// Instead of the video there may be its frames, numbered by frame from 0, in the folder or in images/ or frames/; of
/// thinned frames each takes the GPS row of its number. Unsure: whether every log has exactly a row a frame (users of
/// the data take it so; a log of another length is spread evenly over the drive).
class StLuciaMultipleTimes : public FolderDataset {
 public:
  StLuciaMultipleTimes(const std::string& folder, const Parameters&)
      : FolderDataset("st_lucia_multiple_times", folder, "<ddmmyy_hhmm> folders") {}

  std::vector<std::string> names() override {
    std::vector<std::string> found;
    if (is_folder(folder_))
      for (const std::string& name : folders_in(folder_))
        if (has_form(name, "000000_0000")) found.push_back(name);
    if (found.empty()) not_recognised("<ddmmyy_hhmm>/ with webcam_video.avi or pictures in it");
    return found;
  }

  /// Returns the time of day, "08:45". Two drives share each.
  std::string condition(const std::string& name) override {
    return has_form(name, "000000_0000") ? name.substr(7, 2) + ":" + name.substr(9, 2) : "";
  }
  bool distinctive() override {
    const std::vector<std::string> all = names();
    return std::any_of(all.begin(), all.end(), [&](const std::string& name) {
      return !first_file(below(folder_, name), {"webcam_video.avi", "fGPS.txt", "fgps.txt"}).empty();
    });
  }
  Correspondence correspondence() const override { return Correspondence::kGps; }

 private:
  Traversal read(const std::string& name) override {
    const std::string drive = below(folder_, name);
    std::vector<NumberedFile> pictures;
    for (const std::string sub : {".", "images", "frames"}) {
      const std::string folder = first_folder(drive, {sub});
      if (pictures.empty() && !folder.empty()) pictures = numbered_files(folder, image_suffixes());
    }
    const std::vector<std::string> videos = files_in(drive, video_suffixes());
    if (pictures.empty() && videos.empty()) throw Error("has neither a video nor pictures", drive, "fetch its archive");
    std::vector<std::string> paths;
    for (const NumberedFile& file : pictures) paths.push_back(file.path);
    Traversal traversal =
        paths.empty() ? filmed(name, {below(drive, videos.front())}) : pictured(name, std::move(paths), drive);

    const std::string log = first_file(drive, {"fGPS.txt", "fgps.txt", "GPS.txt"});
    if (log.empty()) return traversal;
    GpsRows rows = read_gps_rows(log);
    for (double& latitude : rows.latitude) latitude = -std::abs(latitude);  // 27.5 degrees south
    rows = pictures.empty() ? spread(rows, traversal.frames) : rows_of(pictures, rows);
    locate(traversal, rows.latitude, rows.longitude);
    return traversal;
  }

  /// Returns each picture's row by its number, when the log reaches as far as the numbers do.
  static GpsRows rows_of(const std::vector<NumberedFile>& pictures, const GpsRows& rows) {
    const auto frames = static_cast<int>(pictures.size());
    if (pictures.back().number >= static_cast<long>(rows.latitude.size())) return spread(rows, frames);
    GpsRows result;
    for (const NumberedFile& file : pictures) {
      result.latitude.push_back(rows.latitude[static_cast<std::size_t>(file.number)]);
      result.longitude.push_back(rows.longitude[static_cast<std::size_t>(file.number)]);
    }
    return result;
  }
};

const DatasetRegistry::Registration st_lucia_multiple_times_registration({
    "st_lucia_multiple_times",
    "St Lucia Multiple Times of Day: one suburban route driven ten times from morning to afternoon",
    {},
    open_folder<StLuciaMultipleTimes>,
    {},
    {{"paper",
      "Glover, Maddern, Milford, Wyeth: FAB-MAP + RatSLAM: Appearance-based SLAM for Multiple Times of Day, "
      "ICRA 2010"},
     {"address", "https://wiki.qut.edu.au/display/cyphy/St+Lucia+Multiple+Times+of+Day"},
     {"licence", "none stated; the page asks to cite the paper"},
     {"size", "ten drives, each a video of 640 x 480 at 15 Hz in an archive of its own"}},
});

}  // namespace
}  // namespace citylearn
