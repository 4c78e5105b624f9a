// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <string>

#include "env_service/files/text_table.h"
#include "env_service/images/image_sources.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/text.h"

// Small trees in the layouts of published datasets.

namespace citylearn::testing {

/// A picture of one colour; the file's suffix says how it is stored.
inline void write_picture(const std::string& path, const cv::Scalar& colour = {40, 90, 160},
                          const cv::Size& size = {16, 8}) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  ASSERT_TRUE(cv::imwrite(path, cv::Mat(size, CV_8UC3, colour))) << path;
}

/// A video (Motion JPEG in AVI, whatever the suffix) whose frame i is grey of 20 i.
inline void write_avi(const std::string& path, int frames, double rate) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  const std::string avi = path + ".avi";
  {
    cv::VideoWriter writer(avi, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), rate, cv::Size(32, 16));
    ASSERT_TRUE(writer.isOpened()) << avi;
    for (int i = 0; i < frames; ++i) writer.write(cv::Mat(16, 32, CV_8UC3, cv::Scalar::all(20 * i)));
  }
  std::filesystem::rename(avi, path);
}

inline cv::Mat picture_of(const Traversal& traversal, int frame) {
  Bytes bytes;
  traversal.images->read(frame, bytes);
  return decode_image(bytes, traversal.images->name(frame));
}

/// Metres of a degree of latitude, or of longitude on the equator, on the sphere that positions are measured on.
inline constexpr double kDegree = 6371008.8 * 3.14159265358979323846 / 180;

}  // namespace citylearn::testing
