// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/json_file.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr double kMilliseconds = 1e-3;
constexpr double kBddReach = 1.5;  // seconds; the phones logged their position once a second

/// BDD100K (Yu et al., CVPR 2020): 100,000 rides of 40 s through American cities, filmed by phones behind windscreens.
///   videos/**/<id>.mov: 720p at 30 Hz
///   info/**/<id>.json: "startTime" (milliseconds since 1970) and "locations", each with "timestamp" (milliseconds),
///     "latitude" and "longitude" in degrees, about one a second
///   labels/100k/<split>/<id>.json, or lists like labels/bdd100k_labels_images_train.json and
///   labels/det_20/det_train.json of
///     {"name": "<id>.jpg", "attributes": {"weather": ..., "timeofday": ...}}: the condition, "night+rainy"
/// A ride is a traversal when its video has an info file. Whether that is complete is checked when it is loaded
/// (100,000 files of 0.3 MB are not opened to list them): at least two locations that cover `seconds` of the ride.
/// Where "locations" is missing, "gps" with the same fields is read. It is not certain that "startTime" is the time of
/// the first frame to less than a second.
class Bdd100k : public FolderDataset {
 public:
  Bdd100k(const std::string& folder, const Parameters& parameters)
      : FolderDataset("bdd100k", folder, "videos and info"), seconds_(parameters["seconds"]) {}

  std::vector<std::string> names() override {
    std::vector<std::string> found;
    for (const auto& [name, path] : videos())
      if (infos().contains(name)) found.push_back(name);
    if (found.empty()) not_recognised("videos/<id>.mov with an info/<id>.json in it");
    return found;
  }

  std::string condition(const std::string& name) override {
    for (const std::string& split : splits())
      if (const std::string path = first_file(
              folder_, {"labels/100k/" + split + "/" + name + ".json", "labels/" + split + "/" + name + ".json"});
          !path.empty())
        return condition_of(without_boxes(path));
    const auto found = conditions().find(name);
    return found == conditions().end() ? "" : found->second;
  }

  Correspondence correspondence() const override { return Correspondence::kGps; }

 private:
  Traversal read(const std::string& name) override {
    const std::string video = videos().at(name);
    Traversal traversal = filmed(name, video);
    if (traversal.times.empty()) throw Error("does not say when its frames are shown", video);
    const std::string path = infos().at(name);
    const json info = read_json(path);
    const double start = json_number(info, "startTime", path) * kMilliseconds;
    for (double& time : traversal.times) time += start;

    const json& locations = info.contains("locations") ? info["locations"] : info.value("gps", json::array());
    GpsRows rows;
    rows.log = path;
    if (!locations.is_array()) throw Error("\"locations\" is not a list", path);
    for (const json& location : locations) {
      const double time = json_number(location, "timestamp", path) * kMilliseconds;
      if (rows.falls(time)) throw Error("a \"timestamp\" before the one before it in \"locations\"", path);
      const double north = json_number(location, "latitude", path);
      rows.add(time, north, json_number(location, "longitude", path));
    }
    const double covered = rows.times.size() < 2 ? 0 : rows.times.back() - rows.times.front();
    if (rows.times.size() < 2 || covered < seconds_)
      throw Error(std::to_string(rows.times.size()) + " locations over " + std::to_string(static_cast<int>(covered)) +
                      " s are too few for a route",
                  path, "take another ride, or lower --bdd100k-seconds");
    locate(traversal, rows, kBddReach);
    return traversal;
  }

  using Paths = std::map<std::string, std::string>;  // by id

  const Paths& videos() { return listed(videos_, "videos", ".mov"); }
  const Paths& infos() { return listed(infos_, "info", ".json"); }

  const Paths& listed(std::optional<Paths>& paths, const std::string& folder, const std::string& suffix) const {
    if (paths) return *paths;
    paths.emplace();
    std::error_code error;
    for (fs::recursive_directory_iterator entry(below(folder_, folder), error), end; !error && entry != end;
         entry.increment(error)) {
      const fs::path& path = entry->path();
      if (lower(path.extension().string()) == suffix && !path.filename().string().starts_with('.'))
        paths->emplace(path.stem().string(), path.string());
    }
    return *paths;
  }

  /// Returns the names of the folders that hold videos: "train", "val", "test".
  const std::set<std::string>& splits() {
    if (splits_.empty())
      for (const auto& [name, path] : videos()) splits_.insert(fs::path(path).parent_path().filename().string());
    return splits_;
  }

  /// Reads labels without the many boxes and outlines, which would fill the memory.
  static json without_boxes(const std::string& path) { return read_json_without(path, {"labels", "frames"}); }

  static std::string condition_of(const json& label) {
    std::string condition;
    if (!label.is_object() || !label.contains("attributes") || !label["attributes"].is_object()) return condition;
    for (const char* attribute : {"timeofday", "weather"}) {
      const auto found = label["attributes"].find(attribute);
      if (found == label["attributes"].end() || !found->is_string() || *found == "undefined") continue;
      condition += (condition.empty() ? "" : "+") + found->get<std::string>();
    }
    return condition;
  }

  /// Returns the conditions from the lists of labels, which are read once and only when a condition is asked for.
  const std::map<std::string, std::string>& conditions() {
    if (conditions_) return *conditions_;
    conditions_.emplace();
    for (const std::string folder : {"labels", "labels/det_20"}) {
      const std::string path = below(folder_, folder);
      if (!is_folder(path)) continue;
      for (const std::string& file : files_in(path, {".json"})) {
        const json list = without_boxes(below(path, file));
        if (!list.is_array()) continue;
        for (const json& label : list)
          if (label.is_object() && label.contains("name") && label["name"].is_string())
            conditions_->emplace(stem_of(label["name"].get<std::string>()), condition_of(label));
      }
    }
    return *conditions_;
  }

  double seconds_;
  std::optional<Paths> videos_, infos_;
  std::set<std::string> splits_;
  std::optional<std::map<std::string, std::string>> conditions_;
};

const DatasetRegistry::Registration bdd100k_registration({
    "bdd100k",
    "BDD100K: rides of 40 s through American cities, with GPS; each is its own route",
    {{"seconds", "least time that a ride's locations cover", 10, 0, 40}},
    open_folder<Bdd100k>,
    {},
    {{"paper", "Yu et al.: BDD100K: A Diverse Driving Dataset for Heterogeneous Multitask Learning, CVPR 2020"},
     {"address", "https://bdd-data.berkeley.edu"},
     {"licence", "BDD100K licence: free for education, research and not-for-profit; commercial use by agreement"},
     {"size", "videos 1.8 TB in 100 archives"}},
});

}  // namespace
}  // namespace citylearn
