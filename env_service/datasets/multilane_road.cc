// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <map>

#include "core/util/text.h"
#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

constexpr int kDepth = 4;  // folders below --data that are looked into

/// Multi-Lane Road Sideways-Camera Datasets (Pepperell, Corke, Milford, ICRA 2015): two roads of 4 km and 4 lanes near
/// the Gold Coast, "highway" (Gold Coast Highway) and "suburban" (Christine Avenue), each driven in several lanes by
/// day and by night with a camera looking sideways. Published is one archive with a Readme.txt; its inner layout is not
/// described elsewhere, so the reader takes what is there: each folder of numbered pictures, and each video, whose path
/// below --data holds "highway" or "suburban" is a traversal; its name is that path with '-' for '/'. "day" and "night"
/// in the path are the condition. Positions come from a text file of "latitude, longitude" rows beside the pictures or
/// the video, whose name holds "gps" (gps.csv, day_lane1_gps.txt); else they are unknown. All of this is unsure but the
/// names of the two roads.
class MultilaneRoad : public FolderDataset {
 public:
  MultilaneRoad(const std::string& folder, const Parameters&)
      : FolderDataset("multilane_road", folder, "the highway or suburban recordings") {}

  std::vector<std::string> names() override {
    std::vector<std::string> found;
    for (const auto& [name, path] : recordings()) found.push_back(name);
    if (found.empty()) not_recognised("pictures or video in it below a folder named highway or suburban");
    return found;
  }

  std::string condition(const std::string& name) override {
    const std::string small = lower(name);
    if (small.find("night") != std::string::npos) return "night";
    return small.find("day") != std::string::npos ? "day" : "";
  }

  bool distinctive() override { return correspondence() == Correspondence::kGps; }

  Correspondence correspondence() const override {
    const std::map<std::string, std::string> all = recordings();
    const bool located =
        std::any_of(all.begin(), all.end(), [](const auto& one) { return !gps_of(one.second).empty(); });
    return located ? Correspondence::kGps : Correspondence::kIndex;
  }

 private:
  Traversal read(const std::string& name) override {
    const std::string path = recordings().at(name), log = gps_of(path);
    Traversal traversal = recorded(name, path);
    if (log.empty()) return traversal;
    const GpsRows rows = spread(read_gps_rows(log), traversal.frames);
    locate(traversal, rows.latitude, rows.longitude);
    return traversal;
  }

  /// Returns the recordings' paths by name.
  std::map<std::string, std::string> recordings() const {
    std::map<std::string, std::string> found;
    if (is_folder(folder_)) look_in(folder_, "", kDepth, found);
    return found;
  }

  void look_in(const std::string& folder, const std::string& name, int depth,
               std::map<std::string, std::string>& found) const {
    const auto named = [&](const std::string& last) { return name.empty() ? last : name + "-" + last; };
    const auto ours = [](const std::string& text) {
      const std::string small = lower(text);
      return small.find("highway") != std::string::npos || small.find("suburban") != std::string::npos;
    };
    if (ours(name) && files_in(folder, image_suffixes()).size() > 1) found[name] = folder;
    for (const std::string& file : files_in(folder, video_suffixes()))
      if (ours(named(stem_of(file)))) found[named(stem_of(file))] = below(folder, file);
    if (depth == 0) return;
    for (const std::string& sub : folders_in(folder)) look_in(below(folder, sub), named(sub), depth - 1, found);
  }

  /// Returns any GPS file in a folder of pictures; beside a video, the one whose name begins like the video's.
  static std::string gps_of(const std::string& path) {
    const bool video = !is_folder(path);
    const std::string folder = video ? fs::path(path).parent_path().string() : path;
    for (const std::string& file : files_in(folder, {".csv", ".txt"}))
      if (lower(file).find("gps") != std::string::npos && (!video || file.starts_with(stem_of(path))))
        return below(folder, file);
    return "";
  }
};

const DatasetRegistry::Registration multilane_road_registration({
    "multilane_road",
    "Multi-Lane Road: a highway and a suburban avenue in several lanes by day and night, camera sideways",
    {},
    open_folder<MultilaneRoad>,
    {},
    {{"paper",
      "Pepperell, Corke, Milford: Automatic Image Scaling for Place Recognition in Changing Environments, ICRA "
      "2015"},
     {"address", "https://qcr.github.io"},
     {"licence", "none stated; the page asks to cite the paper"},
     {"size", "761 MB"}},
});

}  // namespace
}  // namespace citylearn
