// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/layout.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>

#include "core/wire/messages.h"
#include "env_service/dataset_io/parts.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

bool is_digit(char c) { return c >= '0' && c <= '9'; }

}  // namespace

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
    const std::string path = candidate == "." ? folder : below(folder, candidate);
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

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

bool has_form(const std::string& text, const std::string& pattern) {
  return std::equal(text.begin(), text.end(), pattern.begin(), pattern.end(),
                    [](char c, char form) { return form == '0' ? is_digit(c) : c == form; });
}

long last_number(const std::string& text) {
  auto end = std::find_if(text.rbegin(), text.rend(), is_digit).base();
  auto begin = std::find_if_not(std::make_reverse_iterator(end), text.rend(), is_digit).base();
  if (begin == end || end - begin > 18) return -1;
  return std::stol(std::string(begin, end));
}

void require_data(const std::string& dataset, const std::string& folder, const std::string& holds) {
  if (folder.empty()) throw Error("needs the folder of " + holds, "dataset " + dataset, "give it with --data DIR");
}

void not_recognised(const std::string& dataset, const std::string& folder, const std::string& missing) {
  throw Error("is not the dataset " + dataset + ": there is no " + missing, folder,
              is_folder(folder) ? "--data names the folder that holds it" : "there is no such folder");
}

void require_known(const std::string& name, const std::string& folder, const std::vector<std::string>& known) {
  if (std::find(known.begin(), known.end(), name) == known.end()) throw unknown_traversal(name, folder, known);
}

std::vector<NumberedFile> numbered_files(const std::string& folder, const std::vector<std::string>& suffixes,
                                         const std::string& prefix) {
  std::vector<NumberedFile> files;
  for (const std::string& file : files_in(folder, suffixes)) {
    const long number = last_number(stem_of(file));
    if (number >= 0 && file.starts_with(prefix)) files.push_back({number, below(folder, file)});
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
      const auto end = std::find_if(stem.rbegin(), stem.rend(), is_digit).base();
      const auto begin = std::find_if_not(std::make_reverse_iterator(end), stem.rend(), is_digit).base();
      const auto width = static_cast<std::size_t>(end - begin);
      if (digits.size() < width) digits.insert(0, width - digits.size(), '0');
      stem.replace(begin, end, digits);
      all.push_back({number, (neighbour.parent_path() / (stem + neighbour.extension().string())).string()});
    }
    all.push_back(file);
  }
  return all;
}

Traversal pictured(const std::string& dataset, const std::string& name, std::shared_ptr<Images> images,
                   const std::string& where) {
  const int frames = images->frames();
  if (frames < 2) throw Error("has " + std::to_string(frames) + " pictures, a route needs two", where);
  if (frames > static_cast<int>(msg::MAX_FRAMES))
    throw Error("has " + std::to_string(frames) + " pictures, more than " + std::to_string(msg::MAX_FRAMES), where);
  if (name.size() > 64) throw Error("the name of a traversal may have 64 characters", where);
  Traversal traversal;
  traversal.dataset = dataset;
  traversal.name = name;
  traversal.frames = frames;
  traversal.images = std::move(images);
  traversal.positions.assign(static_cast<std::size_t>(frames), std::numeric_limits<float>::quiet_NaN());
  return traversal;
}

void locate(Traversal& traversal, std::vector<double> latitude, std::vector<double> longitude) {
  traversal.positions = metres_along(latitude, longitude);
  traversal.latitude = std::move(latitude);
  traversal.longitude = std::move(longitude);
}

std::vector<double> unknown(int frames) { return std::vector<double>(static_cast<std::size_t>(frames), kUnknown); }

GpsRows read_gps_rows(const std::string& path) {
  TextTable::Options options;
  options.header = false;
  if (read_text(path).find(',') == std::string::npos) options.separator = ' ';
  const TextTable table(path, options);
  GpsRows gps;
  for (int row = 0; row < table.rows(); ++row) {
    if (table.columns(row) < 2) table.fail(row, "not a latitude and a longitude");
    const std::string_view first = table.text(row, 0);
    if (row == 0 && !first.empty() && std::isalpha(static_cast<unsigned char>(first.front()))) continue;
    double latitude = table.number(row, 0), longitude = table.number(row, 1);
    if (std::abs(latitude) > 90 || std::abs(longitude) > 180)
      table.fail(row, "not a latitude and a longitude in degrees");
    if (latitude == 0 && longitude == 0) latitude = longitude = kUnknown;
    gps.latitude.push_back(latitude);
    gps.longitude.push_back(longitude);
  }
  if (gps.latitude.empty()) throw Error("has no positions", path);
  return gps;
}

GpsRows spread(const GpsRows& rows, int frames) {
  const auto known = static_cast<int>(rows.latitude.size());
  GpsRows result{unknown(frames), unknown(frames)};
  if (std::abs(known - frames) * 20 <= frames) {
    const int count = std::min(known, frames);
    std::copy_n(rows.latitude.begin(), count, result.latitude.begin());
    std::copy_n(rows.longitude.begin(), count, result.longitude.begin());
    return result;
  }
  std::vector<double> times, latitude, longitude, at;
  for (int row = 0; row < known; ++row) {
    const auto i = static_cast<std::size_t>(row);
    if (std::isnan(rows.latitude[i])) continue;
    times.push_back(known == 1 ? 0 : static_cast<double>(row) / (known - 1));
    latitude.push_back(rows.latitude[i]);
    longitude.push_back(rows.longitude[i]);
  }
  for (int frame = 0; frame < frames; ++frame)
    at.push_back(frames == 1 ? 0 : static_cast<double>(frame) / (frames - 1));
  if (times.empty()) return result;
  return {interpolate(times, latitude, at, 0), interpolate(times, longitude, at, 0)};
}

nlohmann::json read_json(const std::string& path) {
  const std::string text = read_text(path);
  try {
    return nlohmann::json::parse(text);
  } catch (const nlohmann::json::parse_error& error) {
    throw Error("is not JSON: broken at byte " + std::to_string(error.byte), path, "fetch the file again");
  } catch (const nlohmann::json::exception&) {
    throw Error("holds a number that is too large", path, "fetch the file again");
  }
}

double json_number(const nlohmann::json& object, const std::string& field, const std::string& path) {
  if (!object.is_object() || !object.contains(field)) throw Error("has no \"" + field + "\"", path);
  const nlohmann::json& value = object[field];
  if (!value.is_number() || !std::isfinite(value.get<double>()))
    throw Error("\"" + field + "\" is not a finite number", path);
  return value.get<double>();
}

}  // namespace citylearn
