// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "encoder_service/encoding/area_means.h"
#include "encoder_service/encoding/picture_encoder.h"
#include "encoder_service/encoding/sliding_normalisation.h"
#include "tests/support/data/sample_pictures.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

cv::Mat decoded(const std::vector<uchar>& file) { return decode_picture(std::as_bytes(std::span(file)), "picture"); }

TEST(DecodePicture, JpegHasTheSamePixelsAsFromOpenCv) {
  const cv::Mat picture = drawn_picture(97, 61, 3);
  cv::Mat grey;
  cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  for (const cv::Mat& drawn : {picture, grey})
    for (const int quality : {30, 95, 100})
      for (const int progressive : {0, 1}) {
        std::vector<uchar> file;
        cv::imencode(".jpg", drawn, file,
                     {cv::IMWRITE_JPEG_QUALITY, quality, cv::IMWRITE_JPEG_PROGRESSIVE, progressive});
        const cv::Mat ours = decoded(file), theirs = cv::imdecode(file, cv::IMREAD_COLOR);
        ASSERT_EQ(ours.type(), CV_8UC3);
        EXPECT_EQ(cv::norm(ours, theirs, cv::NORM_INF), 0) << quality << ", " << progressive;
      }
}

/// OpenCV fills what it cannot decode with grey, without a word.
TEST(DecodePicture, DamagedJpegIsRefused) {
  std::vector<uchar> file;
  cv::imencode(".jpg", drawn_picture(97, 61, 3), file);
  for (std::size_t i = file.size() / 2; i < file.size() / 2 + 40; ++i) file[i] = static_cast<uchar>(37 * i);
  ASSERT_FALSE(cv::imdecode(file, cv::IMREAD_COLOR).empty());
  EXPECT_TRUE(contains(error_of([&] { decoded(file); }), "picture: Corrupt JPEG data"));
  file.resize(30);
  EXPECT_THROW(decoded(file), Error);
}

TEST(AreaMeans, AreThoseOfOpenCv) {
  for (const auto& [from, to] : std::vector<std::pair<cv::Size, cv::Size>>{
           {{640, 480}, {128, 64}}, {{97, 53}, {64, 32}}, {{97, 53}, {97, 50}}, {{97, 53}, {1, 1}}, {{9, 1}, {4, 1}}}) {
    cv::Mat grey(from, CV_8U), real, expected;
    cv::randu(grey, 0, 256);
    grey.convertTo(real, CV_32F);
    cv::resize(real, expected, to, 0, 0, cv::INTER_AREA);
    EXPECT_LT(cv::norm(area_means(grey, to), expected, cv::NORM_INF), 1e-3) << from << " to " << to;
  }
}

TEST(SlidingNormalisation, SubtractsGaussianMeansAndDividesByDeviations) {
  for (const double sigma : {0.5, 4., 40.}) {
    cv::Mat picture(31, 50, CV_32FC3), mean, squares, root;
    cv::randu(picture, 0, 255);
    cv::GaussianBlur(picture, mean, {}, sigma);
    cv::GaussianBlur(picture.mul(picture), squares, {}, sigma);
    const cv::Mat variance = squares - mean.mul(mean);
    cv::sqrt(variance + cv::Scalar::all(16), root);
    const cv::Mat expected = (picture - mean) / root,
                  found = SlidingNormalisation(picture.size(), sigma).apply(picture);
    EXPECT_LT(cv::norm(found, expected, cv::NORM_INF), 1e-3) << sigma;
  }
}

TEST(PictureEncoder, ThreadsChangeNothing) {
  std::vector<cv::Mat> pictures;
  for (std::uint64_t i = 0; i < 9; ++i) pictures.push_back(drawn_picture(90, 60, i));
  const int before = cv::getNumThreads();
  for (const std::string name : {"hog_vlad", "patchnorm"}) {
    const auto encoded = [&](int threads) -> Eigen::MatrixXf {
      cv::setNumThreads(threads);
      const auto& entry = EncoderRegistry::instance().find("encoder", name);
      const auto encoder = entry.create(Parameters(entry.name, entry.parameters, {}), {});
      if (encoder->training_sample_count() > 0) encoder->learn(pictures);
      return encoder->encode(pictures);
    };
    EXPECT_EQ(encoded(1), encoded(4)) << name;
  }
  cv::setNumThreads(before);
}

TEST(PictureEncoder, WhatAThreadThrowsIsThrown) {
  const int before = cv::getNumThreads();
  cv::setNumThreads(4);
  EXPECT_THROW(for_each_on_threads(100, [](int i) { i == 77 ? throw Error("77") : void(); }), Error);
  cv::setNumThreads(before);
}

}  // namespace
}  // namespace citylearn::testing
