// SPDX-License-Identifier: Apache-2.0
#include "dashboard/api/recognition_results.h"

#include <algorithm>
#include <filesystem>

#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxFolders = 1000;
constexpr std::size_t kMaxResultBytes = 32 << 20;  // of a file: what vpr writes is far smaller
constexpr const char* kSummary = "results.json";
constexpr const char* kCurves = "curves.json";
constexpr const char* kRemedy = "run vpr again";

}  // namespace

std::vector<RecognitionResults::Folder> RecognitionResults::folders() const {
  std::vector<Folder> found;
  const auto look = [&](const fs::path& path, const std::string& name) {
    std::error_code none;
    if (!fs::is_regular_file(path / kSummary, none)) return;
    Folder folder{name, path.string(), {}, 0};
    const auto time = fs::last_write_time(path / kSummary, none).time_since_epoch();
    folder.time = std::chrono::duration<double>(time).count();
    for (const fs::directory_entry& entry : fs::directory_iterator(path, none)) {
      const std::string file = entry.path().filename().string();
      // A link could show any file that this process may read.
      if (file.starts_with("similarity-") && file.ends_with(".png") && entry.is_regular_file(none) &&
          !entry.is_symlink(none))
        folder.matrices.push_back(file);
    }
    std::sort(folder.matrices.begin(), folder.matrices.end());
    found.push_back(std::move(folder));
  };
  if (folder_.empty()) return found;
  const fs::path root = fs::path(folder_).lexically_normal();
  look(root, root.has_filename() ? root.filename().string() : root.parent_path().filename().string());
  std::error_code none;
  for (const fs::directory_entry& entry : fs::directory_iterator(root, none)) {
    if (found.size() >= kMaxFolders) break;
    if (entry.is_directory(none)) look(entry.path(), entry.path().filename().string());
  }
  std::sort(found.begin(), found.end(), [](const Folder& a, const Folder& b) { return a.time > b.time; });
  return found;
}

std::optional<RecognitionResults::Folder> RecognitionResults::find(const std::string& name) const {
  // The name is compared, never used as a path, so it cannot lead elsewhere.
  for (Folder& folder : folders())
    if (folder.name == name) return std::move(folder);
  return std::nullopt;
}

nlohmann::json RecognitionResults::list() const {
  nlohmann::json results = nlohmann::json::array();
  for (const Folder& folder : folders()) {
    const std::string path = folder.path + "/" + kSummary;
    nlohmann::json result = nlohmann::json::object();
    try {
      nlohmann::json summary = parse_json(read_file(path, kMaxResultBytes), path, kRemedy);
      if (!summary.is_object()) throw Error("is not what vpr writes", path, kRemedy);
      result = std::move(summary);
    } catch (const std::exception& error) {
      result["error"] = error.what();
    }
    result["name"] = folder.name;
    result["file"] = path;
    result["matrices"] = folder.matrices;
    results.push_back(std::move(result));
  }
  return results;
}

std::optional<std::string> RecognitionResults::curves(const std::string& name) const {
  const auto folder = find(name);
  if (!folder) return std::nullopt;
  const std::string path = folder->path + "/" + kCurves;
  if (!fs::exists(path) || fs::is_symlink(path)) return std::nullopt;  // an older vpr wrote none
  return read_file(path, kMaxResultBytes);
}

std::optional<std::string> RecognitionResults::matrix(const std::string& name, const std::string& matrix) const {
  const auto folder = find(name);
  if (!folder || folder->matrices.empty()) return std::nullopt;
  const auto found =
      matrix.empty() ? folder->matrices.begin() : std::find(folder->matrices.begin(), folder->matrices.end(), matrix);
  if (found == folder->matrices.end()) return std::nullopt;
  return read_file(folder->path + "/" + *found, kMaxResultBytes);
}

}  // namespace citylearn
