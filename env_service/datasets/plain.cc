// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>

#include "core/wire/messages.h"
#include "env_service/dataset_io/dataset.h"
#include "env_service/dataset_io/parts.h"
#include "env_service/dataset_io/poses.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

const std::string kMatches = "matches.csv";
const std::string kPoses = ".poses.csv";

/// Traversals of one's own. Each is one of
///   NAME.csv           features: a frame a line, separated by commas, no header
///   NAME/              a folder of pictures, in natural order of their names
///   NAME.mp4, .avi ... a video
/// Beside it NAME.poses.csv (or NAME/poses.csv) may tell where frames are, and matches.csv which frames of two
/// traversals are the same place (poses.h).
class Plain : public Dataset {
 public:
  explicit Plain(const std::string& folder) : folder_(folder) {
    if (folder.empty()) throw Error("needs a folder of NAME.csv files", "dataset plain", "give it with --data DIR");
  }

  std::vector<std::string> names() override {
    std::vector<std::string> names;
    for (const auto& [name, path] : sources()) names.push_back(name);
    return names;
  }

  Traversal load(const std::string& name) override {
    const std::map<std::string, std::string> known = sources();
    const auto found = known.find(name);
    if (found == known.end()) throw unknown_traversal(name, folder_, names());
    const std::string& path = found->second;
    if (name.size() > 64) throw Error("the name of a traversal may have 64 characters", path);
    Traversal traversal;
    traversal.dataset = "plain";
    traversal.name = name;
    traversal.condition = name;
    if (fs::is_directory(path)) {
      std::vector<std::string> paths = files_in(path, image_suffixes());
      for (std::string& file : paths) file.insert(0, path + "/");
      show(traversal, image_files(std::move(paths), folder_), path);
    } else if (path.ends_with(".csv")) {
      read_features(path, traversal);
    } else {
      double rate = 0;
      show(traversal, video_frames(path, folder_, &rate), path);
      for (int frame = 0; rate > 0 && frame < traversal.frames; ++frame) traversal.times.push_back(frame / rate);
    }
    traversal.positions.assign(static_cast<std::size_t>(traversal.frames), std::numeric_limits<float>::quiet_NaN());
    const std::string beside = folder_ + "/" + name + kPoses, inside = folder_ + "/" + name + "/poses.csv";
    const bool is_beside = fs::is_regular_file(beside), is_inside = fs::is_regular_file(inside);
    if (is_beside && is_inside) throw Error("there is " + inside + " too", beside, "remove one of them");
    if (is_beside || is_inside) read_poses(is_beside ? beside : inside, traversal);
    return traversal;
  }

  Correspondence correspondence() const override {
    return fs::is_regular_file(folder_ + "/" + kMatches) ? Correspondence::kMatches : Correspondence::kIndex;
  }

  std::vector<std::pair<int, int>> matches(const std::string& a, const std::string& b) override {
    const std::string path = folder_ + "/" + kMatches;
    if (!fs::is_regular_file(path)) return Dataset::matches(a, b);
    return read_matches(path, a, b);
  }

 private:
  static void show(Traversal& traversal, std::shared_ptr<Images> images, const std::string& path) {
    if (images->frames() < 2) throw Error("has only one frame, a route needs two", path);
    if (images->frames() > static_cast<int>(msg::MAX_FRAMES))
      throw Error("more than " + std::to_string(msg::MAX_FRAMES) + " frames", path);
    traversal.frames = images->frames();
    traversal.images = std::move(images);
  }

  static bool begins_with_a_letter(const std::string& path) {
    std::ifstream file(path);
    char first = 0;
    return file >> first && (std::isalpha(static_cast<unsigned char>(first)) || first == '"');
  }

  /// Path of each traversal, by name.
  std::map<std::string, std::string> sources() const {
    std::map<std::string, std::string> found;
    const auto add = [&](const std::string& name, const std::string& file) {
      const auto [at, added] = found.emplace(name, folder_ + "/" + file);
      if (!added)
        throw Error("traversal '" + name + "' is both " + fs::path(at->second).filename().string() + " and " + file,
                    folder_, "rename or remove one of them");
    };
    try {
      for (const std::string& file : files_in(folder_, video_suffixes())) add(fs::path(file).stem().string(), file);
      for (const std::string& name : folders_in(folder_))
        if (!files_in(folder_ + "/" + name, image_suffixes()).empty()) add(name, name);
      // Beside pictures, a table whose columns have names is something about them. Where there are none, it is meant
      // as features, and reading it will say what is wrong.
      const bool pictures = !found.empty();
      for (const std::string& file : files_in(folder_, {".csv"}))
        if (file.ends_with(".csv") && file != kMatches && !file.ends_with(kPoses) &&
            !(pictures && begins_with_a_letter(folder_ + "/" + file)))
          add(file.substr(0, file.size() - 4), file);
    } catch (const Error& error) {
      if (fs::is_directory(folder_)) throw;
      throw Error(error.what(), "", "--data names the folder that holds the NAME.csv files");
    }
    if (found.empty() && !files_in(folder_, image_suffixes()).empty())
      throw Error("holds pictures itself", folder_,
                  "--data names the folder above, in which each folder is a traversal");
    return found;
  }

  std::string folder_;
};

const DatasetRegistry::Registration registration({
    "plain",
    "a folder (--data) of traversals: NAME.csv (one frame a line, comma-separated features, no header), a folder NAME "
    "of pictures, or a video NAME.mp4; NAME.poses.csv and matches.csv may tell places",
    {},
    [](const Parameters&, const std::string& folder) { return std::make_unique<Plain>(folder); },
    {},
    {{"paper", "none"}, {"address", "your own recordings"}, {"licence", "yours"}, {"size", "any"}},
});

}  // namespace
}  // namespace citylearn
