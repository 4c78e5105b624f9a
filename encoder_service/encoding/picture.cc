// SPDX-License-Identifier: Apache-2.0
#include <turbojpeg.h>

#include <memory>
#include <opencv2/imgcodecs.hpp>

#include "core/files/image_header.h"
#include "encoder_service/encoding/encoder.h"

namespace citylearn {
namespace {

/// Decodes a JPEG file in colour, with the library that OpenCV calls too, straight to BGR: OpenCV takes as long again
/// to swap the channels. Returns an empty picture where it leaves the file to OpenCV: other formats and colours,
/// damage.
cv::Mat decode_colour_jpeg(std::span<const std::byte> file, const ImageHeader& header) {
  const auto* bytes = reinterpret_cast<const unsigned char*>(file.data());
  const std::unique_ptr<void, int (*)(tjhandle)> decoder(tjInitDecompress(), tjDestroy);
  int width = 0, height = 0, subsampling = 0, colours = 0;
  if (header.format != "jpeg" || !decoder ||
      tjDecompressHeader3(decoder.get(), bytes, file.size(), &width, &height, &subsampling, &colours) != 0 ||
      (colours != TJCS_YCbCr && colours != TJCS_RGB) || width != header.width || height != header.height)
    return {};
  cv::Mat picture(height, width, CV_8UC3);
  const int failed = tjDecompress2(decoder.get(), bytes, file.size(), picture.data, width,
                                   static_cast<int>(picture.step), height, TJPF_BGR, TJFLAG_STOPONWARNING);
  return failed ? cv::Mat() : picture;
}

}  // namespace

cv::Mat decode_picture(std::span<const std::byte> file, const std::string& where) {
  if (file.size() > kMaxImageBytes) throw Error("an image file of more than 64 MiB", where);
  const ImageHeader header = read_image_header(file, where);
  try {
    if (cv::Mat picture = decode_colour_jpeg(file, header); !picture.empty()) return picture;
    const cv::Mat bytes(1, static_cast<int>(file.size()), CV_8U, const_cast<std::byte*>(file.data()));
    // Files are shown as their pixels lie: positions and siblings know nothing of a camera's orientation tag.
    cv::Mat picture = cv::imdecode(bytes, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
    if (picture.cols == header.width && picture.rows == header.height) return picture;
  } catch (const cv::Exception& exception) {
    throw Error(std::string("OpenCV cannot decode it: ") + exception.err, where);
  }
  throw Error("a broken " + header.format + " image", where);
}

}  // namespace citylearn
