// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <string>

#include "core/util/error.h"
#include "tests/support/files.h"

namespace citylearn::testing {

/// A small picture of one brightness.
inline void write_grey(const std::string& path, int brightness) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  if (!cv::imwrite(path, cv::Mat(24, 32, CV_8UC3, cv::Scalar::all(brightness)))) throw Error("cannot write", path);
}

/// A video whose frame i has the brightness 4 i + 20; false where OpenCV has no such encoder.
inline bool write_video(const std::string& path, int frames, const char* codec = "MJPG", double rate = 25) {
  cv::VideoWriter writer(path, cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]), rate, cv::Size(64, 48));
  if (!writer.isOpened()) return false;
  for (int i = 0; i < frames; ++i) writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(4 * i + 20)));
  return true;
}

}  // namespace citylearn::testing
