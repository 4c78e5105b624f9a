// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/imgcodecs.hpp>

#include "env_service/images/image_sources.h"
#include "tests/support/data/fake_images.h"

namespace citylearn::paper {

/// Pictures of 20 x 2 whose columns are numbered.
class NumberedPictures : public testing::FakeImages {
 public:
  NumberedPictures() : FakeImages(3) {}
  void read(int frame, Bytes& bytes) override {
    cv::Mat picture(2, 20, CV_8UC3);
    for (int x = 0; x < picture.cols; ++x) picture.col(x).setTo(cv::Scalar(x, frame, 7));
    encode_png(picture, bytes);
  }
};

}  // namespace citylearn::paper
