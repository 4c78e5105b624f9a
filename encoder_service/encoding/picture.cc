// SPDX-License-Identifier: Apache-2.0
#include <opencv2/imgcodecs.hpp>

#include "core/files/image_header.h"
#include "encoder_service/encoding/encoder.h"

namespace citylearn {
cv::Mat decode_picture(std::span<const std::byte> file, const std::string& where) {
  if (file.size() > kMaxImageBytes) throw Error("an image file of more than 64 MiB", where);
  const ImageHeader header = read_image_header(file, where);
  try {
    cv::Mat picture(header.format == "jpeg" ? header.height : 0, header.width, CV_8UC3);
    if (decode_jpeg(file, header, where, picture.data)) return picture;
    const cv::Mat bytes(1, static_cast<int>(file.size()), CV_8U, const_cast<std::byte*>(file.data()));
    // As pixels lie: an env_service turns pictures upright where it reads them.
    picture = cv::imdecode(bytes, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
    if (picture.cols == header.width && picture.rows == header.height) return picture;
  } catch (const cv::Exception& exception) {
    throw Error(std::string("OpenCV cannot decode it: ") + exception.err, where);
  }
  throw Error("a broken " + header.format + " image", where);
}

}  // namespace citylearn
