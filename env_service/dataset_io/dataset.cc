// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/dataset.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "core/task/live.h"
#include "core/util/text.h"
#include "env_service/files/files.h"
#include "env_service/streets/street_graph.h"

namespace citylearn {
namespace {

/// Files of which a folder that no dataset reads may consist, and what to do with it.
struct Foreign {
  const char *ending, *what, *remedy;
  const char* dataset = nullptr;  // that reads sound ones and says what is wrong with others
};
constexpr const char *kFeatures = "has arrays, which are not read",
                     *kWriteTable = "write each recording as a table: numpy.savetxt('NAME.csv', array, delimiter=',')";
constexpr Foreign kForeign[] = {
    {"meta/info.json", "is a dataset of LeRobot",
     "make recordings of its episodes: python3 -m citylearn.lerobot DATASET FOLDER, with the Python package"},
    {".bag", "is a bag of ROS 1, which is not read", "convert it: rosbags-convert --src FILE.bag --dst FOLDER"},
    {".ldb", "has StreetLearn in a folder of its own", "--data names that folder", "streetlearn"},
    {".npy", kFeatures, kWriteTable},
    {".npz", kFeatures, kWriteTable},
    {".safetensors", kFeatures, kWriteTable},
    {".pbf", "is a street map, not a recording", "put it beside recordings with positions, for --rule street"},
    {".osm", "is a street map, not a recording", "put it beside recordings with positions, for --rule street"},
};
constexpr long kMaxVisited = 100'000;  // files

std::unique_ptr<Dataset> opened(const DatasetRegistry::Entry& entry, const std::string& folder) {
  return entry.create(Parameters("dataset " + entry.name, entry.parameters, {}), folder);
}

/// Returns the Error for a folder in which there are no traversals. It names what is there.
Error no_traversals(const std::string& folder) {
  namespace fs = std::filesystem;
  std::map<std::string, long> kinds;
  std::string deep;  // the first folder of pictures or films
  std::error_code error;
  long visited = 0;
  for (fs::recursive_directory_iterator at(folder, fs::directory_options::skip_permission_denied, error), end;
       !error && at != end && ++visited < kMaxVisited; at.increment(error)) {
    const std::string path = lower(path_below(at->path().string(), folder));
    if (at->is_directory(error)) continue;
    for (const auto& [ending, what, remedy, dataset] : kForeign) {
      if (!path.ends_with(ending)) continue;
      try {
        if (dataset)
          opened(DatasetRegistry::instance().find("dataset", dataset), at->path().parent_path().string())->names();
      } catch (const Error& fault) {
        return fault;
      }
      return Error(std::string("no traversals found: it ") + what, folder, remedy);
    }
    const std::string suffix = lower(at->path().extension().string());
    ++kinds[suffix.empty() ? "without a suffix" : suffix];
    for (const auto* suffixes : {&image_suffixes(), &video_suffixes()})
      if (std::find(suffixes->begin(), suffixes->end(), suffix) != suffixes->end())
        deep = deep.empty() ? at->path().parent_path().string() : std::min(deep, at->path().parent_path().string());
  }
  if (!deep.empty())
    return Error("no traversals found; pictures or films are in " + one_line(path_below(deep, folder)), folder,
                 "--data names the folder of which each folder, or film, is a traversal");
  const std::string there =
      joined(kinds, [](const auto& kind) { return std::to_string(kind.second) + " " + one_line(kind.first); });
  return Error("no traversals found; expected NAME/, NAME.mp4 or NAME.csv", folder,
               there.empty() ? "" : "files there: " + there);
}

enum class Fit { kNone, kPossible, kDistinctive };

Fit fit_of(const DatasetRegistry::Entry& entry, const std::string& folder) {
  try {
    const auto dataset = opened(entry, folder);
    return dataset->names().empty() ? Fit::kNone : dataset->distinctive() ? Fit::kDistinctive : Fit::kPossible;
  } catch (const Error&) {
    // What "plain" says of a folder, as of one name twice, goes before what others take of it.
    return entry.name == "plain" && is_folder(folder) ? Fit::kPossible : Fit::kNone;
  }
}

}  // namespace

std::vector<std::string> recognised(const std::string& folder) {
  std::vector<std::string> distinctive, possible;
  for (const auto* entry : DatasetRegistry::instance().entries()) {
    const Fit fit = entry->name == kLive || fit_of(*entry, "") != Fit::kNone ? Fit::kNone : fit_of(*entry, folder);
    if (fit == Fit::kDistinctive) distinctive.push_back(entry->name);
    if (fit == Fit::kPossible) possible.insert(entry->name == "plain" ? possible.begin() : possible.end(), entry->name);
  }
  distinctive.insert(distinctive.end(), possible.begin(), possible.end());
  return distinctive;
}

void warn_of_arrays(const std::string& folder) {
  if (const auto arrays = files_in(folder, {".npy", ".npz", ".safetensors"}); !arrays.empty())
    spdlog::warn("{}: {} {} ({})", folder, one_line(arrays[0]), kFeatures, kWriteTable);
}

Error unknown_traversal(const std::string& name, const std::string& where, const std::vector<std::string>& known) {
  if (known.empty()) return no_traversals(where);
  return Error("no traversal '" + name + "'", where, "there are: " + joined(known));
}

std::vector<std::string> Dataset::describe_streets() {
  const auto map = streets();
  return map ? map->description() : std::vector<std::string>();
}

std::vector<std::pair<int, int>> Dataset::matches(const std::string& a, const std::string& b) {
  throw Error("no match file for '" + a + "' and '" + b + "'", "", "align by index, distance or gps");
}

}  // namespace citylearn
