// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "env_service/dataset_io/images.h"
#include "env_service/dataset_io/traversal.h"

namespace cv {
class Mat;
}

// What readers of published datasets share. Every Error names the file, and the line where there is one.

namespace citylearn {

/// The whole file. Throws Error: it cannot be read, or is larger than `most` bytes.
std::string read_text(const std::string& path, std::size_t most = std::size_t{1} << 30);

/// Names (not paths) of a folder's files that end in one of `suffixes` (letter case ignored; hidden files left out), in
/// natural order: "img2" before "img10". Throws Error when the folder cannot be read.
std::vector<std::string> files_in(const std::string& folder, const std::vector<std::string>& suffixes);
/// Names of a folder's folders, likewise.
std::vector<std::string> folders_in(const std::string& folder);
/// Suffixes of files that image_files() reads, and of those that video_frames() reads.
const std::vector<std::string>& image_suffixes();
const std::vector<std::string>& video_suffixes();

/// `path` less `root`, a folder above it; the whole path when it isn't.
std::string path_below(const std::string& path, const std::string& root);

/// Rows of a text file of fields. Line ends may be LF, CRLF or CR alone; a byte order mark, empty lines and lines that
/// begin with '#' are passed over.
class TextTable {
 public:
  struct Options {
    char separator = ',';  ///< ' ' stands for any run of blanks and tabs
    bool header = true;    ///< the first row names the columns
  };
  TextTable(const std::string& path, const Options& options);

  int rows() const;
  int columns(int row) const;
  bool has(const std::string& column) const;
  /// Field of a row by the column's name or index, blanks at its ends removed. Throws Error: no such column.
  std::string_view text(int row, const std::string& column) const;
  std::string_view text(int row, int column) const;
  /// The same as a finite number. Throws Error otherwise.
  double number(int row, const std::string& column) const;
  double number(int row, int column) const;
  /// Throws Error about this row: "PATH:LINE: what (remedy)".
  [[noreturn]] void fail(int row, const std::string& what, const std::string& remedy = "") const;
  const std::string& path() const;

 private:
  struct Parts;
  std::shared_ptr<const Parts> parts_;
};

/// Features of a file without header: a frame a line, numbers between commas. Fills frames, dimension and features.
/// Throws Error naming the line: no number, not as many columns as before, an empty line between frames.
void read_features(const std::string& path, Traversal& traversal);

/// Images of one file a frame. Looks at each file's first and last bytes at once: for its fingerprint and fault().
/// `paths` may name files that are missing: those have a fault. `root` is what names leave out.
std::shared_ptr<Images> image_files(std::vector<std::string> paths, const std::string& root);

/// Every frame of a video, as PNG. Forward reads are quick, others seek. Throws Error when it cannot be opened or tells
/// no number of frames. `rate` (when given) becomes frames per second.
std::shared_ptr<Images> video_frames(const std::string& path, const std::string& root, double* rate = nullptr);

/// `images` with something done to each picture (8-bit; 1 or 3 channels, BGR): demosaicing, a crop. `recipe` names it
/// with all its numbers and becomes part of the fingerprint.
std::shared_ptr<Images> changed(std::shared_ptr<Images> images, const std::string& recipe,
                                std::function<cv::Mat(const cv::Mat&)> change);

/// Frames `which` of `images`, in that order; indices may repeat.
std::shared_ptr<Images> picked(std::shared_ptr<Images> images, std::vector<int> which);

/// The last read pictures are kept, at most `most` bytes of them.
std::shared_ptr<Images> cached(std::shared_ptr<Images> images, std::size_t most = std::size_t{32} << 20);

/// Metres along a route through these points (degrees, WGS 84; great circles on a sphere of 6,371,008.8 m). NaN at NaN,
/// which is passed over.
std::vector<float> metres_along(const std::vector<double>& latitude, const std::vector<double>& longitude);
/// Metres along a route through points of a plane, in metres.
std::vector<float> metres_along_plane(const std::vector<double>& x, const std::vector<double>& y);
/// Metres between two points of the earth.
double metres_between(double latitude_a, double longitude_a, double latitude_b, double longitude_b);

/// Values at `at`, linear between the samples (times must not fall; equal ones: the later counts). NaN outside of them
/// by more than `reach` seconds; within it the nearest sample.
std::vector<double> interpolate(const std::vector<double>& times, const std::vector<double>& values,
                                const std::vector<double>& at, double reach);

/// An 8-bit picture (1 or 3 channels, BGR) as the bytes of a PNG file; quick rather than small.
void encode_png(const cv::Mat& picture, Bytes& bytes);
/// The picture in an image file, 3 channels, BGR. Throws Error naming `where`: too large, broken, unknown.
cv::Mat decode_image(const Bytes& file, const std::string& where);
/// Reads and decodes a frame; why that cannot be done, empty when it can. `bytes` is room to work in.
std::string decoding_fault(Images& images, int frame, Bytes& bytes);

}  // namespace citylearn
