// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "env_service/dataset_io/dataset.h"

// What readers of published layouts share beyond parts.h: finding what is where, and filling a Traversal. Every Error
// names the folder or file.

namespace citylearn {

bool is_folder(const std::string& path);
bool is_file(const std::string& path);
/// "/a" and "b" become "/a/b".
std::string below(const std::string& folder, const std::string& name);
/// The first of `candidates` (below `folder`, "." is itself) that is a folder, as a path; empty when none is.
std::string first_folder(const std::string& folder, const std::vector<std::string>& candidates);
/// Likewise for a file.
std::string first_file(const std::string& folder, const std::vector<std::string>& candidates);
/// "frame10.png" becomes "frame10".
std::string stem_of(const std::string& file);
/// In small letters.
std::string lower(std::string text);
/// Whether `text` looks like `pattern`, where '0' stands for any digit and everything else for itself.
bool has_form(const std::string& text, const std::string& pattern);
/// The last run of digits in `text`, or -1 when there is none (or it is too long).
long last_number(const std::string& text);

/// Throws Error when no --data was given.
void require_data(const std::string& dataset, const std::string& folder, const std::string& holds);
/// Throws Error: `folder` is not `dataset`, `missing` is not there.
[[noreturn]] void not_recognised(const std::string& dataset, const std::string& folder, const std::string& missing);
/// Throws Error (unknown_traversal) unless `name` is among `known`.
void require_known(const std::string& name, const std::string& folder, const std::vector<std::string>& known);

struct NumberedFile {
  long number = 0;
  std::string path;
};
/// A folder's files whose names begin with `prefix` and hold a number, by number. Where at least nine in ten of the
/// numbers between the first and the last are there, the others are told too, as files that are missing; with more
/// holes the folder was thinned on purpose and they are passed over. Throws Error: two files of one number.
std::vector<NumberedFile> numbered_files(const std::string& folder, const std::vector<std::string>& suffixes,
                                         const std::string& prefix = "");

/// A traversal with these pictures, positions not known yet. Throws Error naming `where`: less than 2 frames, or more
/// than msg::MAX_FRAMES.
Traversal pictured(const std::string& dataset, const std::string& name, std::shared_ptr<Images> images,
                   const std::string& where);
/// Gives the frames latitude and longitude (degrees, NaN where unknown) and from them positions.
void locate(Traversal& traversal, std::vector<double> latitude, std::vector<double> longitude);
/// NaN, so many times.
std::vector<double> unknown(int frames);

/// Latitude and longitude in a GPS log, a row each.
struct GpsRows {
  std::vector<double> latitude, longitude;
};
/// Reads "latitude, longitude" in degrees (further columns are passed over; the separator is a comma or blanks; a first
/// row of words is a header). 0, 0 is no fix. Throws Error naming the line: no number, or out of range.
GpsRows read_gps_rows(const std::string& path);
/// Rows for frames: row i is frame i when there are about as many (within a twentieth); else the log is spread evenly
/// over the recording.
GpsRows spread(const GpsRows& rows, int frames);

/// The file as JSON. Throws Error naming where it breaks off.
nlohmann::json read_json(const std::string& path);
/// A finite number of an object. Throws Error naming the field.
double json_number(const nlohmann::json& object, const std::string& field, const std::string& path);

}  // namespace citylearn
