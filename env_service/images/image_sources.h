// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "env_service/images/images.h"

namespace cv {
class Mat;
}

namespace citylearn {

/// Images of one file a frame, of which HEIF files are read as PNG. Looks at each file's first and last bytes at once,
/// for its fingerprint and fault(), and turns those upright that have an EXIF orientation, HEIF by its own turns alone;
/// no other reader turns pictures.
/// `paths` may name files that are missing: those have a fault. `root` is what names leave out.
std::shared_ptr<Images> image_files(std::vector<std::string> paths, const std::string& root);

/// Every picture of a video in the order in which they are shown, as PNG, upright, in the colours that its tags say.
/// Forward reads are quick, others seek. Reads the whole file once, for its index. `times` (when given) becomes the
/// pictures' times in seconds; empty when the video does not tell. `began` becomes the moment of second 0, in seconds
/// since 1970 in UTC, by the film's own word; NaN when it has none. Throws Error when the video is broken or cut short.
std::shared_ptr<Images> video_frames(const std::string& path, const std::string& root,
                                     std::vector<double>* times = nullptr, double* began = nullptr);

/// `images` with something done to each picture (8-bit; 1 or 3 channels, BGR): demosaicing, a crop. `recipe` names it
/// with all its numbers and becomes part of the fingerprint.
std::shared_ptr<Images> changed(std::shared_ptr<Images> images, const std::string& recipe,
                                std::function<cv::Mat(const cv::Mat&)> change);

/// Returns `images`, each moved to the right by `share` of its width; its edge repeats where nothing is left.
std::shared_ptr<Images> moved(std::shared_ptr<Images> images, double share);

/// Returns the frames `which` of `images`, in that order; indices may repeat.
std::shared_ptr<Images> picked(std::shared_ptr<Images> images, std::vector<int> which);

/// Returns the frames of all of these, one after the other; at least one.
std::shared_ptr<Images> joined(std::vector<std::shared_ptr<Images>> parts);

/// `images` with a cache of the last pictures read, at most `most` bytes of them.
std::shared_ptr<Images> cached(std::shared_ptr<Images> images, std::size_t most = std::size_t{32} << 20);

/// Encodes an 8-bit picture (1 or 3 channels, BGR) as a PNG file; quick rather than small.
void encode_png(const cv::Mat& picture, Bytes& bytes);
/// Decodes an image file to 3 channels, BGR. Throws Error naming `where` when it is too large, broken or unknown.
cv::Mat decode_image(const Bytes& file, const std::string& where);
/// Reads and decodes a frame. Returns why that fails; empty when it does not. `bytes` is a buffer; `brightest` becomes
/// the largest value of its pixels, of 255.
std::string decoding_fault(Images& images, int frame, Bytes& bytes, double& brightest);

}  // namespace citylearn
