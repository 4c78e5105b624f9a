// SPDX-License-Identifier: Apache-2.0
#include "env_service/images/video_picture.h"

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libswscale/swscale.h>
}

#include <cstdlib>

namespace citylearn {

const std::int32_t* display_matrix(const AVStream& stream) {
#if LIBAVFORMAT_VERSION_MAJOR >= 61
  const AVPacketSideData* const found = av_packet_side_data_get(
      stream.codecpar->coded_side_data, stream.codecpar->nb_coded_side_data, AV_PKT_DATA_DISPLAYMATRIX);
  const void* const data = found && found->size >= 9 * sizeof(std::int32_t) ? found->data : nullptr;
#else
  std::size_t size = 0;
  const void* const data = av_stream_get_side_data(&stream, AV_PKT_DATA_DISPLAYMATRIX, &size);
#endif
  return static_cast<const std::int32_t*>(data);
}

PictureConverter::~PictureConverter() { sws_freeContext(scaler_); }

cv::Mat PictureConverter::upright_bgr(const AVFrame& from, const std::int32_t* m) {
  const int width = from.width, height = from.height;
  const auto format = static_cast<AVPixelFormat>(from.format);
  scaler_ = sws_getCachedContext(scaler_, width, height, format, width, height, AV_PIX_FMT_BGR24, SWS_BICUBIC, nullptr,
                                 nullptr, nullptr);
  if (!scaler_) return {};
  int *matrix = nullptr, *table = nullptr, full = 0, to_full = 0, brightness = 0, contrast = 0, saturation = 0;
  sws_getColorspaceDetails(scaler_, &matrix, &full, &table, &to_full, &brightness, &contrast, &saturation);
  if (from.color_range != AVCOL_RANGE_UNSPECIFIED) full = from.color_range == AVCOL_RANGE_JPEG;
  sws_setColorspaceDetails(scaler_, sws_getCoefficients(from.colorspace), full, table, to_full, brightness, contrast,
                           saturation);
  cv::Mat rows(height, (width + 63) / 64 * 64, CV_8UC3);  // the scaler may write beyond a row's end
  std::uint8_t* const to[] = {rows.data};
  const int step[] = {static_cast<int>(rows.step)};
  if (sws_scale(scaler_, from.data, from.linesize, 0, height, to, step) != height) return {};
  cv::Mat picture = rows.colRange(0, width);
  if (!m) return picture;
  const bool on_its_side = std::abs(std::int64_t{m[1]}) > std::abs(std::int64_t{m[0]});
  const bool left_right = (on_its_side ? m[3] : m[0]) < 0, up_down = (on_its_side ? m[1] : m[4]) < 0;
  if (on_its_side) cv::transpose(picture, picture);
  if (left_right || up_down) cv::flip(picture, picture, left_right && up_down ? -1 : left_right ? 1 : 0);
  return picture;
}

}  // namespace citylearn
