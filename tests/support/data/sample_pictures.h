// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "core/util/random.h"
#include "tests/paths.h"
#include "tests/support/data/real_data.h"

namespace citylearn::testing {

/// A blurred random picture: texture without any file.
inline cv::Mat drawn_picture(int width, int height, std::uint64_t seed) {
  Random random{seed, 0x70696374ull};
  cv::Mat picture(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      picture.at<cv::Vec3b>(y, x) = {static_cast<uchar>(random.below(256)), static_cast<uchar>(random.below(256)),
                                     static_cast<uchar>(random.below(256))};
  cv::GaussianBlur(picture, picture, {5, 5}, 0);
  return picture;
}

/// Every `step`-th picture of a traversal of the Nordland sample, in order; empty when the data are not there.
inline std::vector<cv::Mat> nordland(const std::string& traversal, std::size_t step) {
  namespace fs = std::filesystem;
  const fs::path folder = real_data(CITYLEARN_SOURCE_DIR, "nordland-64x32/" + traversal);
  std::vector<fs::path> files;
  if (fs::is_directory(folder))
    for (const auto& entry : fs::directory_iterator(folder))
      if (entry.path().extension() == ".png") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<cv::Mat> pictures;
  for (std::size_t i = 0; i < files.size(); i += step) pictures.push_back(cv::imread(files[i].string()));
  return pictures;
}

}  // namespace citylearn::testing
