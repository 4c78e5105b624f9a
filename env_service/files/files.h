// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

// Files of published datasets. Every Error names the file or folder.

namespace citylearn {

/// Bytes of the largest table or JSON file.
inline constexpr std::size_t kMaxTextBytes = std::size_t{1} << 30;

/// Returns the names (not paths) of a folder's files that end in one of `suffixes`, whatever the letter case, without
/// hidden files, in natural order: "img2" before "img10". Throws Error when the folder cannot be read.
std::vector<std::string> files_in(const std::string& folder, const std::vector<std::string>& suffixes);
/// Returns the names of a folder's folders, likewise.
std::vector<std::string> folders_in(const std::string& folder);
/// Returns the paths of `folder` and of those up to `depth` below it that hold pictures, also such as cannot be read.
std::vector<std::string> picture_folders(const std::string& folder, int depth);
/// Returns when pictures, given by name, were taken: seconds of one clock, NaN where that is not known.
using PictureTimes = std::function<std::vector<double>(const std::vector<std::string>& names)>;
/// Returns the names of a folder's pictures in the order of the recording: by time where `times` tells all of them, and
/// by name where times are equal or none are told. Names are in natural order, or by number where they differ in one
/// decimal number ("9.5" before "10.25"). Leaves out copies ("1 (1).jpg") of pictures, with a warning, and warns where
/// nothing gives an order. Throws Error naming files when pictures of other kinds would be left out, two have one name,
/// or a counter seems to have wrapped and times do not say so.
std::vector<std::string> pictures_in(const std::string& folder, const PictureTimes& times = {});
/// Suffixes of files that image_files() reads, of pictures that it does not, and of those that video_frames() reads.
const std::vector<std::string>& image_suffixes();
const std::vector<std::string>& unread_image_suffixes();
const std::vector<std::string>& video_suffixes();

/// Returns the films in `folder`, or in its folder `within`, each as the paths below `folder` of its chapters
/// in order: GoPros begin a new file every few gigabytes. GX010123, GX020123 and GX030123, and GOPR0123, GP010123 and
/// GP020123, are chapters of one film. Throws Error naming the file whose chapter before is not there.
std::vector<std::vector<std::string>> films_in(const std::string& folder, const std::string& within);

bool is_folder(const std::string& path);
bool is_file(const std::string& path);
/// "/a" and "b" become "/a/b".
std::string below(const std::string& folder, const std::string& name);
/// Returns `path` without `root`, a folder above it; the whole path when it is not.
std::string path_below(const std::string& path, const std::string& root);
/// Returns the path of the first of `candidates` (below `folder`, "." is itself) that is a folder; empty when none is.
std::string first_folder(const std::string& folder, const std::vector<std::string>& candidates);
/// Does the same for a file.
std::string first_file(const std::string& folder, const std::vector<std::string>& candidates);

/// "frame10.png" becomes "frame10".
std::string stem_of(const std::string& file);
/// Returns whether `text` looks like `pattern`, in which '0' stands for any digit.
bool has_form(const std::string& text, const std::string& pattern);
/// Returns the last run of digits in `text`, or -1 when there is none or it is too long.
long last_number(const std::string& text);

struct NumberedFile {
  long number = 0;
  std::string path;
};
/// Returns a folder's files whose names hold a number, by number. Where at least nine in ten of the numbers between the
/// first and the last are there, the others are listed too, as missing files; with more holes the folder was thinned on
/// purpose and they are left out. Throws Error when two files have one number.
std::vector<NumberedFile> numbered_files(const std::string& folder, const std::vector<std::string>& suffixes);

}  // namespace citylearn
