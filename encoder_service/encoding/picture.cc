// SPDX-License-Identifier: Apache-2.0
#include <opencv2/imgcodecs.hpp>

#include "core/files/image_header.h"
#include "encoder_service/encoding/encoder.h"

namespace citylearn {

cv::Mat decode_picture(std::span<const std::byte> file, const std::string& where) {
  if (file.size() > kMaxImageBytes) throw Error("an image file of more than 64 MiB", where);
  const ImageHeader header = read_image_header(file, where);
  try {
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
