// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/descriptors.h"

#include <gtest/gtest.h>

#include <cstring>
#include <opencv2/core.hpp>

#include "tests/support/data/fake_images.h"

namespace citylearn::lab {
namespace {

/// Plain pictures, each as bright as its frame's number says.
class Greys : public testing::FakeImages {
 public:
  using FakeImages::FakeImages;
  void read(int frame, Bytes& bytes) override {
    const std::string file = "P6 8 8 255\n" + std::string(8 * 8 * 3, static_cast<char>(10 * frame));
    bytes.resize(file.size());
    std::memcpy(bytes.data(), file.data(), file.size());
  }
};

class TwoPictures : public Encoder {
 public:
  Spec spec() const override { return {"two-1", 1, 1}; }
  Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) override {
    return Eigen::MatrixXf::Zero(1, static_cast<Eigen::Index>(pictures.size()));
  }
  int training_sample_count() const override { return 2; }
  void learn(std::span<const cv::Mat> pictures) override {
    for (const cv::Mat& picture : pictures) learned.push_back(picture.at<cv::Vec3b>(0, 0)[0]);
  }
  std::vector<int> learned;
};

// As an encoder_service: of four frames the middles of two halves, 1 and 3.
TEST(FitEncoder, TakesTheFramesThatAnEncoderServiceTakes) {
  Traversal traversal;
  traversal.frames = 4;
  traversal.images = std::make_shared<Greys>(4);
  TwoPictures encoder;
  fit_encoder(encoder, traversal);
  EXPECT_EQ(encoder.learned, (std::vector<int>{10, 30}));
}

}  // namespace
}  // namespace citylearn::lab
