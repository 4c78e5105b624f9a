// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/picture_shrink.h"

#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/files/image_header.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

constexpr int kQuality = 85;

}  // namespace

PictureFile shrink(const Bytes& file, const PictureLimits& limits, const std::string& where) {
  const int widest = limits.widest;
  const ImageHeader header = read_image_header(file, where);
  if (header.width <= widest && file.size() <= limits.bytes && (header.format == "jpeg" || header.format == "png"))
    return {"image/" + header.format, std::string(reinterpret_cast<const char*>(file.data()), file.size())};
  try {
    // Large JPEGs are decoded at a fraction of their size, which is several times faster.
    const int times = header.width / widest;
    const int how = times >= 8   ? cv::IMREAD_REDUCED_COLOR_8
                    : times >= 4 ? cv::IMREAD_REDUCED_COLOR_4
                    : times >= 2 ? cv::IMREAD_REDUCED_COLOR_2
                                 : cv::IMREAD_COLOR;
    // imdecode() only reads.
    const cv::Mat bytes(1, static_cast<int>(file.size()), CV_8U,
                        const_cast<void*>(static_cast<const void*>(file.data())));
    cv::Mat picture = cv::imdecode(bytes, how);
    if (picture.empty()) throw Error("cannot be decoded", where);
    if (picture.cols > widest) {
      const int height = std::max(1, static_cast<int>(std::lround(picture.rows * (double{1} * widest / picture.cols))));
      cv::Mat smaller;
      cv::resize(picture, smaller, {widest, height}, 0, 0, cv::INTER_AREA);
      picture = smaller;
    }
    std::vector<std::uint8_t> jpeg;
    if (!cv::imencode(".jpg", picture, jpeg, {cv::IMWRITE_JPEG_QUALITY, kQuality}))
      throw Error("cannot be made a JPEG", where);
    return {"image/jpeg", std::string(jpeg.begin(), jpeg.end())};
  } catch (const cv::Exception& exception) {
    throw Error(std::string("OpenCV: ") + exception.what(), where);
  }
}

}  // namespace citylearn
