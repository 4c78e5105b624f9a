// SPDX-License-Identifier: Apache-2.0
#include "env_service/files/files.h"

#include <strings.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <map>

#include "core/util/error.h"
#include "core/util/text.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

bool digit(char c) { return c >= '0' && c <= '9'; }

/// "img2" before "IMG10": runs of digits compare as numbers, letters without their case. Names of equal worth ("1",
/// "01") compare as text.
bool natural_less(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (digit(a[i]) && digit(b[j])) {
      while (i < a.size() && a[i] == '0') ++i;
      while (j < b.size() && b[j] == '0') ++j;
      std::size_t end_a = i, end_b = j;
      while (end_a < a.size() && digit(a[end_a])) ++end_a;
      while (end_b < b.size() && digit(b[end_b])) ++end_b;
      if (end_a - i != end_b - j) return end_a - i < end_b - j;
      if (const int order = a.compare(i, end_a - i, b, j, end_b - j)) return order < 0;
      i = end_a;
      j = end_b;
    } else {
      const int x = std::tolower(static_cast<unsigned char>(a[i])), y = std::tolower(static_cast<unsigned char>(b[j]));
      if (x != y) return x < y;
      ++i;
      ++j;
    }
  }
  if ((i < a.size()) != (j < b.size())) return j < b.size();
  return a < b;
}

bool has_suffix(const std::string& name, const std::vector<std::string>& suffixes) {
  return std::any_of(suffixes.begin(), suffixes.end(), [&](const std::string& suffix) {
    return name.size() > suffix.size() && ::strcasecmp(name.c_str() + name.size() - suffix.size(), suffix.c_str()) == 0;
  });
}

template <class Wanted>
std::vector<std::string> entries_in(const std::string& folder, Wanted wanted) {
  std::error_code error;
  std::vector<std::string> names;
  // Stepping with an error code: a folder that fails half way is an Error, not an exception of another kind.
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    std::string name = at->path().filename().string();
    if (!name.starts_with('.') && wanted(name, *at)) names.push_back(std::move(name));
  }
  if (error) throw Error(error.message(), folder);
  std::sort(names.begin(), names.end(), natural_less);
  return names;
}

}  // namespace

std::vector<std::string> files_in(const std::string& folder, const std::vector<std::string>& suffixes) {
  return entries_in(folder, [&](const std::string& name, const fs::directory_entry& entry) {
    std::error_code ignored;
    return has_suffix(name, suffixes) && entry.is_regular_file(ignored);
  });
}

std::vector<std::string> folders_in(const std::string& folder) {
  return entries_in(folder, [](const std::string&, const fs::directory_entry& entry) {
    std::error_code ignored;
    return entry.is_directory(ignored);
  });
}

std::string path_below(const std::string& path, const std::string& root) {
  std::size_t end = root.size();
  while (end > 0 && root[end - 1] == '/') --end;
  if (root.empty() || path.compare(0, end, root, 0, end) != 0 || path.size() <= end || path[end] != '/') return path;
  return path.substr(std::min(path.find_first_not_of('/', end), path.size()));
}

const std::vector<std::string>& image_suffixes() {
  static const std::vector<std::string> suffixes{".jpg", ".jpeg", ".jpe", ".jfif", ".png",  ".bmp",  ".dib",
                                                 ".pgm", ".ppm",  ".pbm", ".pnm",  ".heic", ".heif", ".hif"};
  return suffixes;
}

const std::vector<std::string>& unread_image_suffixes() {
  static const std::vector<std::string> suffixes{
      ".tif", ".tiff", ".webp", ".avif", ".gif", ".jp2", ".j2k", ".jxl", ".exr", ".hdr", ".pfm", ".dng", ".cr2",
      ".cr3", ".nef",  ".arw",  ".orf",  ".rw2", ".raf", ".pef", ".srw", ".raw", ".tga", ".mpo", ".ras"};
  return suffixes;
}

const std::vector<std::string>& video_suffixes() {
  static const std::vector<std::string> suffixes{".mp4", ".avi",  ".mkv", ".mov", ".m4v",  ".mpg",  ".mpeg",
                                                 ".vob", ".webm", ".wmv", ".ts",  ".m2ts", ".mts",  ".3gp",
                                                 ".3g2", ".flv",  ".f4v", ".ogv", ".asf",  ".divx", ".mxf"};
  return suffixes;
}

std::vector<std::vector<std::string>> films_in(const std::string& folder, const std::string& within) {
  const fs::path inside(within);
  std::vector<std::vector<std::string>> films;
  std::map<std::string, std::map<int, std::string>> chaptered;  // by what all chapters' names share
  for (const std::string& file : files_in(within.empty() ? folder : below(folder, within), video_suffixes())) {
    const std::string name = lower(stem_of(file)), kind = lower(fs::path(file).extension().string());
    std::string path = (inside / file).string(), shared;
    int chapter = 0;
    if (has_form(name, "gopr0000")) {
      shared = "gp" + name.substr(4);
    } else if (has_form(name, "gp000000") || has_form(name, "gh000000") || has_form(name, "gx000000")) {
      shared = name.substr(0, 2) + name.substr(4);
      chapter = std::stoi(name.substr(2, 2));
    }
    if (shared.empty() || !chaptered[shared + kind].try_emplace(chapter, path).second)
      films.push_back({std::move(path)});
  }
  for (auto& [shared, chapters] : chaptered) {
    std::vector<std::string>& film = films.emplace_back();
    for (int next = chapters.begin()->first; auto& [chapter, file] : chapters) {
      if (chapter != next++)
        throw Error("the chapter before it is not there", below(folder, file), "copy it too, or move this one away");
      film.push_back(std::move(file));
    }
  }
  return films;
}

bool is_folder(const std::string& path) {
  std::error_code error;
  return fs::is_directory(path, error);
}

bool is_file(const std::string& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

std::string below(const std::string& folder, const std::string& name) { return (fs::path(folder) / name).string(); }

std::string first_folder(const std::string& folder, const std::vector<std::string>& candidates) {
  for (const std::string& candidate : candidates) {
    std::string path = candidate == "." ? folder : below(folder, candidate);
    if (is_folder(path)) return path;
  }
  return "";
}

std::string first_file(const std::string& folder, const std::vector<std::string>& candidates) {
  for (const std::string& candidate : candidates)
    if (is_file(below(folder, candidate))) return below(folder, candidate);
  return "";
}

std::string stem_of(const std::string& file) { return fs::path(file).stem().string(); }

bool has_form(const std::string& text, const std::string& pattern) {
  return std::equal(text.begin(), text.end(), pattern.begin(), pattern.end(),
                    [](char c, char form) { return form == '0' ? digit(c) : c == form; });
}

long last_number(const std::string& text) {
  auto end = std::find_if(text.rbegin(), text.rend(), digit).base();
  auto begin = std::find_if_not(std::make_reverse_iterator(end), text.rend(), digit).base();
  if (begin == end || end - begin > 18) return -1;
  return std::stol(std::string(begin, end));
}

std::vector<NumberedFile> numbered_files(const std::string& folder, const std::vector<std::string>& suffixes) {
  std::vector<NumberedFile> files;
  for (const std::string& file : suffixes == image_suffixes() ? pictures_in(folder) : files_in(folder, suffixes)) {
    const long number = last_number(stem_of(file));
    if (number >= 0) files.push_back({number, below(folder, file)});
  }
  std::stable_sort(files.begin(), files.end(), [](auto& a, auto& b) { return a.number < b.number; });
  for (std::size_t i = 1; i < files.size(); ++i)
    if (files[i].number == files[i - 1].number)
      throw Error("has the same number as " + fs::path(files[i - 1].path).filename().string(), files[i].path,
                  "move one of them away");
  if (files.empty()) return files;
  const long wanted = files.back().number - files.front().number + 1;
  if (static_cast<double>(files.size()) < 0.9 * static_cast<double>(wanted)) return files;

  std::vector<NumberedFile> all;
  for (const NumberedFile& file : files) {
    for (long number = all.empty() ? file.number : all.back().number + 1; number < file.number; ++number) {
      // Its name is its neighbour's with another number of as many digits.
      const fs::path neighbour = file.path;
      std::string stem = neighbour.stem().string(), digits = std::to_string(number);
      const auto end = std::find_if(stem.rbegin(), stem.rend(), digit).base();
      const auto begin = std::find_if_not(std::make_reverse_iterator(end), stem.rend(), digit).base();
      const auto width = static_cast<std::size_t>(end - begin);
      if (digits.size() < width) digits.insert(0, width - digits.size(), '0');
      stem.replace(begin, end, digits);
      all.push_back({number, (neighbour.parent_path() / (stem + neighbour.extension().string())).string()});
    }
    all.push_back(file);
  }
  return all;
}

}  // namespace citylearn
