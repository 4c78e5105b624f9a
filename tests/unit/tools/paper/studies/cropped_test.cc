// SPDX-License-Identifier: Apache-2.0
// Parts of pictures.
#include "tools/paper/studies/cropped.h"

#include <gtest/gtest.h>

#include "core/util/error.h"
#include "encoder_service/encoding/encoder.h"
#include "tests/unit/tools/paper/numbered_pictures.h"

namespace citylearn::paper {
namespace {

TEST(Cropped, ShowsThePartAskedFor) {
  const auto pictures = std::make_shared<NumberedPictures>();
  const auto part = cropped(pictures, 0.1, 0.8);
  Bytes bytes;
  part->read(2, bytes);
  const cv::Mat picture = decode_picture(bytes, "a part");
  ASSERT_EQ(picture.cols, 16);
  ASSERT_EQ(picture.rows, 2);
  EXPECT_EQ(picture.at<cv::Vec3b>(1, 0), cv::Vec3b(2, 2, 7));
  EXPECT_EQ(picture.at<cv::Vec3b>(0, 15), cv::Vec3b(17, 2, 7));
  EXPECT_NE(part->fingerprint(2), pictures->fingerprint(2));
  EXPECT_NE(part->fingerprint(2), cropped(pictures, 0.2, 0.8)->fingerprint(2));
  EXPECT_THROW(cropped(pictures, 0.3, 0.8), Error);
}

}  // namespace
}  // namespace citylearn::paper
