// SPDX-License-Identifier: Apache-2.0
// Parts of pictures, and a simulated condition between two recordings.
#include "tools/paper/studies/simulated.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

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

TEST(Mixture, GoesFromPlaceToPlaceBetweenBoth) {
  std::set<double> shares;
  for (int frame = 0; frame < 400; ++frame) {
    const double share = share_of_second(frame);
    EXPECT_GE(share, 0.2);
    EXPECT_LE(share, 0.8);
    EXPECT_LT(std::abs(share_of_second(frame + 1) - share), 0.05) << "neighbouring frames look alike";
    shares.insert(share);
  }
  EXPECT_LT(*shares.begin(), 0.35);
  EXPECT_GT(*shares.rbegin(), 0.65);
}

TEST(Mixture, OfFeaturesKeepsTheirLength) {
  Traversal one, other;
  one.dimension = other.dimension = 2;
  one.frames = other.frames = 2;
  one.features = {1, 0, 3, 0};
  other.features = {0, 1, 0, 3};
  one.positions = other.positions = {0, 10};
  const Traversal mixed = mixture(one, other, "mixed");
  EXPECT_EQ(mixed.name, "mixed");
  for (const int frame : {0, 1}) {
    const std::span<const float> feature = mixed.feature(frame);
    const double share = share_of_second(frame);
    EXPECT_NEAR(std::hypot(feature[0], feature[1]), frame == 0 ? 1 : 3, 1e-5);
    EXPECT_NEAR(feature[1] / feature[0], share / (1 - share), 1e-5);
  }
  other.dimension = 1;
  EXPECT_THROW(mixture(one, other, "mixed"), Error);
}

TEST(Mixture, OfPicturesIsAPicture) {
  Traversal one;
  one.frames = 3;
  one.positions = {0, 10, 20};
  one.images = std::make_shared<NumberedPictures>();
  const Traversal same = mixture(one, one, "same");
  Bytes bytes;
  same.images->read(2, bytes);
  const cv::Mat picture = decode_picture(bytes, "a mixture");
  ASSERT_EQ(picture.cols, 20);
  EXPECT_EQ(picture.at<cv::Vec3b>(1, 5), cv::Vec3b(5, 2, 7));
  EXPECT_NE(same.images->fingerprint(2), one.images->fingerprint(2));
  EXPECT_NE(same.images->fingerprint(2), mixture(one, same, "other").images->fingerprint(2));
}

}  // namespace
}  // namespace citylearn::paper
