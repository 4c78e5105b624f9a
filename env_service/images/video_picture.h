// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

struct AVFrame;
struct AVStream;
struct SwsContext;

namespace citylearn {

/// Returns the display matrix of a film's track (9 numbers), by which its pictures are turned; null when it has none.
const std::int32_t* display_matrix(const AVStream& stream);

/// Makes upright pictures of decoded ones. Used by one thread.
class PictureConverter {
 public:
  PictureConverter() = default;
  ~PictureConverter();
  PictureConverter(const PictureConverter&) = delete;
  PictureConverter& operator=(const PictureConverter&) = delete;

  /// Returns BGR, 8-bit, as FFmpeg's tools do: by the picture's tags, of which a missing matrix is BT.601's and a
  /// missing range limited. HDR stays as it is coded, and so do pixels that are not square. Turns and mirrors it by
  /// display matrix `m` (null: none), which takes (x, y) to (m[0] x + m[3] y, m[1] x + m[4] y). Returns an empty
  /// picture where that fails.
  cv::Mat upright_bgr(const AVFrame& from, const std::int32_t* m);

 private:
  SwsContext* scaler_ = nullptr;  // of the size and format seen last
};

}  // namespace citylearn
