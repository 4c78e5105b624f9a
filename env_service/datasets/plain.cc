// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>

#include "core/task/live.h"
#include "core/util/text.h"
#include "env_service/dataset_io/features.h"
#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/dataset_io/poses.h"
#include "env_service/files/files.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

const std::string kMatches = "matches.csv";
const std::string kPoses = ".poses.csv";
constexpr int kPictureDepth = 3;  // folders below that of a traversal in which its pictures may lie

/// Your own traversals. Each is one of
///   NAME.csv           features: a frame a line, separated by commas, no header
///   NAME/              a folder of pictures, or that holds one with them, in the order of pictures_in()
///   NAME.mp4, .avi ... a video
/// Beside it NAME.poses.csv (or NAME/poses.csv) may say where frames are, and matches.csv which frames of two
/// traversals are the same place (poses.h).
class Plain : public FolderDataset {
 public:
  Plain(const std::string& folder, const Parameters&) : Plain("plain", folder) {}

  std::vector<std::string> names() override {
    std::vector<std::string> names;
    for (const auto& [name, path] : sources()) names.push_back(name);
    return names;
  }

  bool distinctive() override { return false; }

  Correspondence correspondence() const override {
    return matches_file().empty() ? Correspondence::kIndex : Correspondence::kMatches;
  }

  std::vector<std::pair<int, int>> matches(const std::string& a, const std::string& b) override {
    return matches_file().empty() ? Dataset::matches(a, b) : read_matches(matches_file(), a, b);
  }

 protected:
  Plain(const std::string& dataset, const std::string& folder) : FolderDataset(dataset, folder, "NAME.csv files") {}

 private:
  Traversal read(const std::string& name) override {
    const std::string path = sources().at(name);
    Traversal traversal = is_folder(path)                 ? photographed(name, path)
                          : lower(path).ends_with(".csv") ? featured(name, path)
                                                          : filmed(name, path);
    const std::string inside = folder_ + "/" + name + "/poses.csv";
    std::string beside;
    for (const std::string& file : files_in(folder_, {kPoses}))
      if (file.starts_with(name) && file.size() == name.size() + kPoses.size()) beside = folder_ + "/" + file;
    const bool is_beside = !beside.empty(), is_inside = is_file(inside);
    if (is_beside && is_inside) throw Error("there is " + inside + " too", beside, "remove one of them");
    if (is_beside || is_inside) read_poses(is_beside ? beside : inside, traversal);
    return traversal;
  }

  /// Returns the pictures of a folder, or of the only folder below it that has any.
  Traversal photographed(const std::string& name, const std::string& path) const {
    const std::vector<std::string> folders = picture_folders(path, kPictureDepth);
    if (folders.size() > 1 && folders[0] != path)
      throw Error("has pictures in " + path_below(folders[0], path) + " and in " + path_below(folders[1], path), path,
                  "leave one of them; or give a folder below with --data");
    if (folders.size() > 1) spdlog::warn("{}: pictures in {} are not read", path, path_below(folders[1], path));
    std::vector<std::string> paths = pictures_in(folders[0]);
    for (std::string& file : paths) file.insert(0, folders[0] + "/");
    return pictured(name, std::move(paths), path);
  }

  Traversal featured(const std::string& name, const std::string& path) const {
    if (name.size() > 64) throw Error("the name of a traversal may have 64 characters", path);
    Traversal traversal;
    traversal.dataset = dataset_;
    traversal.name = name;
    read_features(path, traversal);
    traversal.positions.assign(static_cast<std::size_t>(traversal.frames), std::numeric_limits<float>::quiet_NaN());
    return traversal;
  }

  static bool begins_with_a_letter(const std::string& path) {
    std::ifstream file(path);
    char first = 0;
    return file >> first && (std::isalpha(static_cast<unsigned char>(first)) || first == '"');
  }

  /// Returns the path of each traversal, by name.
  std::map<std::string, std::string> sources() const {
    std::map<std::string, std::string> found;
    const auto add = [&](const std::string& name, const std::string& file) {
      const auto [at, added] = found.emplace(name, folder_ + "/" + file);
      if (!added)
        throw Error("traversal '" + name + "' is both " + fs::path(at->second).filename().string() + " and " + file,
                    folder_, "rename or remove one of them");
    };
    try {
      for (const std::string& file : files_in(folder_, video_suffixes())) add(stem_of(file), file);
      for (const std::string& name : folders_in(folder_))
        if (!picture_folders(folder_ + "/" + name, kPictureDepth).empty()) add(name, name);
      // Beside pictures, a table whose columns have names describes them. Where there are no pictures, it is meant
      // as features, and reading it will say what is wrong.
      const bool pictures = !found.empty();
      for (const std::string& file : files_in(folder_, {".csv"}))
        if (file != kMatches && !lower(file).ends_with(kPoses) &&
            !(pictures && begins_with_a_letter(folder_ + "/" + file)))
          add(file.substr(0, file.size() - 4), file);
    } catch (const Error& error) {
      if (is_folder(folder_)) throw;
      throw Error(error.what(), "", "--data names the folder that holds the NAME.csv files");
    }
    if (found.empty() && !picture_folders(folder_, 0).empty())
      throw Error("holds pictures itself", folder_,
                  "--data names the folder above, in which each folder is a traversal");
    return found;
  }
};

/// A robot on a route that it was taught, which is a traversal of Plain.
class Live : public Plain {
 public:
  Live(const std::string& folder, const Parameters&) : Plain(kLive, folder) {}
};

const DatasetRegistry::Registration live_registration({
    kLive,
    "a robot that drives a route which it was taught: --data has the route as dataset plain, --camera and --position "
    "are topics of ROS 2",
    {},
    open_folder<Live>,
    {},
    {{"paper", "none"}, {"address", "your own robot"}, {"licence", "yours"}, {"size", "any"}},
});

const DatasetRegistry::Registration plain_registration({
    "plain",
    "a folder (--data) of traversals: NAME.csv (one frame a line, comma-separated features, no header), a folder NAME "
    "of pictures, or a video NAME.mp4; NAME.poses.csv and matches.csv may give places",
    {},
    open_folder<Plain>,
    {},
    {{"paper", "none"}, {"address", "your own recordings"}, {"licence", "yours"}, {"size", "any"}},
});

}  // namespace
}  // namespace citylearn
