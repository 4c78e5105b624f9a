// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstring>
#include <opencv2/imgcodecs.hpp>

#include "env_service/images/images.h"

namespace citylearn::paper {

/// Pictures of 20 x 2 whose columns are numbered.
class NumberedPictures : public Images {
 public:
  int frames() const override { return 3; }
  void read(int frame, Bytes& bytes) override {
    cv::Mat picture(2, 20, CV_8UC3);
    for (int x = 0; x < picture.cols; ++x) picture.col(x).setTo(cv::Scalar(x, frame, 7));
    std::vector<unsigned char> file;
    cv::imencode(".png", picture, file);
    bytes.resize(file.size());
    std::memcpy(bytes.data(), file.data(), file.size());
  }
  std::string name(int frame) const override { return "number " + std::to_string(frame); }
  std::uint64_t fingerprint(int frame) const override { return static_cast<std::uint64_t>(frame); }
  std::string fault(int) const override { return {}; }
};

}  // namespace citylearn::paper
