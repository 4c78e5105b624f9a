// SPDX-License-Identifier: Apache-2.0
// What every encoder without files promises, whichever it is.
#include <gtest/gtest.h>
#include <stdlib.h>

#include "encoder_service/encoding/encoder.h"
#include "tests/support/data/sample_pictures.h"

namespace citylearn::testing {
namespace {

/// Returns what an encoder needs beside its parameters, as far as it is here.
EncoderFiles files_of(const std::string& encoder) {
  ::setenv("CITYLEARN_PYTHON", "/usr/bin/python3", 0);
  EncoderFiles files;
  if (encoder == "python") files.model = CITYLEARN_SOURCE_DIR "/tests/support/encoder.py";
  return files;
}

/// Encoders that need a network's file are tested with theirs.
std::vector<std::string> names() {
  std::vector<std::string> result;
  for (const auto* entry : EncoderRegistry::instance().entries()) {
    try {
      // Each test lists them all, and those of a file take a while to start.
      if (!files_of(entry->name).model.empty() || entry->create(Parameters(entry->name, entry->parameters, {}), {}))
        result.push_back(entry->name);
    } catch (const Error&) {
    }
  }
  return result;
}

class EncoderContract : public ::testing::TestWithParam<std::string> {
 protected:
  static std::unique_ptr<Encoder> make(const std::map<std::string, double>& values = {}) {
    const auto& entry = EncoderRegistry::instance().find("encoder", GetParam());
    return entry.create(Parameters(entry.name, entry.parameters, values), files_of(entry.name));
  }
  static std::vector<cv::Mat> training_sample() {
    std::vector<cv::Mat> pictures;
    for (std::uint64_t i = 0; i < 12; ++i) pictures.push_back(drawn_picture(64, 32, i));
    return pictures;
  }
  static std::unique_ptr<Encoder> learned() {
    auto encoder = make();
    if (encoder->training_sample_count() > 0) encoder->learn(training_sample());
    return encoder;
  }
};

TEST_P(EncoderContract, SpecIsUsable) {
  const Encoder::Spec spec = learned()->spec();
  EXPECT_TRUE(spec.name.starts_with(GetParam())) << spec.name;
  EXPECT_LE(spec.name.size(), 200u);
  EXPECT_GT(spec.dimension, 0);
  EXPECT_GT(spec.batch, 0);
}

TEST_P(EncoderContract, AnyPictureGivesFiniteNumbers) {
  const auto encoder = learned();
  cv::Mat grey(48, 64, CV_8UC3, cv::Scalar(90, 90, 90));
  const std::vector<cv::Mat> pictures = {drawn_picture(64, 32, 1),
                                         drawn_picture(1, 1, 2),
                                         drawn_picture(1, 50, 3),
                                         drawn_picture(300, 1, 4),
                                         drawn_picture(97, 41, 5),
                                         drawn_picture(640, 480, 6),
                                         grey,
                                         cv::Mat::zeros(32, 64, CV_8UC3)};
  const Eigen::MatrixXf descriptors = encoder->encode(pictures);
  EXPECT_EQ(descriptors.rows(), encoder->spec().dimension);
  EXPECT_EQ(descriptors.cols(), static_cast<Eigen::Index>(pictures.size()));
  EXPECT_TRUE(descriptors.allFinite());
  EXPECT_EQ(encoder->encode({}).cols(), 0);
  EXPECT_GT((descriptors.col(0) - descriptors.col(4)).norm(), 1e-3f);
}

TEST_P(EncoderContract, NumbersDoNotDependOnTheBatchNorOnWhatWasBefore) {
  const auto encoder = learned();
  std::vector<cv::Mat> pictures;
  for (std::uint64_t i = 0; i < 7; ++i) pictures.push_back(drawn_picture(60 + static_cast<int>(i) * 9, 40, 20 + i));
  const Eigen::MatrixXf together = encoder->encode(pictures);
  for (std::size_t i = pictures.size(); i-- > 0;) {
    const Eigen::MatrixXf alone = encoder->encode({&pictures[i], 1});
    EXPECT_LT((alone - together.col(static_cast<Eigen::Index>(i))).norm(), 1e-5f * (1 + alone.norm())) << i;
  }
}

TEST_P(EncoderContract, PartOfALargerPictureIsLikeACopy) {
  // A cv::Mat may be a view whose rows are not one after another.
  const auto encoder = learned();
  const cv::Mat large = drawn_picture(100, 80, 9);
  const cv::Mat view = large(cv::Rect(13, 7, 64, 32)), copy = view.clone();
  const cv::Mat before = large.clone();
  EXPECT_EQ(encoder->encode({&view, 1}), encoder->encode({&copy, 1}));
  EXPECT_EQ(cv::norm(before, large, cv::NORM_INF), 0) << "the picture itself was changed";
}

TEST_P(EncoderContract, OtherKindsOfPicturesAreRefused) {
  const auto encoder = learned();
  for (const cv::Mat& wrong : {cv::Mat(), cv::Mat(8, 8, CV_8UC1, cv::Scalar(1)), cv::Mat(8, 8, CV_32FC3, cv::Scalar(1)),
                               cv::Mat(8, 8, CV_8UC4, cv::Scalar(1))})
    EXPECT_THROW(encoder->encode({&wrong, 1}), Error);
}

TEST_P(EncoderContract, LearnedStateComesBack) {
  const auto encoder = learned();
  if (encoder->training_sample_count() == 0) {
    EXPECT_TRUE(encoder->state().empty());
    return;
  }
  const cv::Mat picture = drawn_picture(64, 32, 77);
  EXPECT_THROW(make()->encode({&picture, 1}), Error) << "before it learned";

  const Bytes state = encoder->state();
  const auto other = make();
  other->restore(state);
  EXPECT_EQ(other->spec().name, encoder->spec().name);
  EXPECT_EQ(other->encode({&picture, 1}), encoder->encode({&picture, 1}));
  EXPECT_EQ(other->state(), state);
  EXPECT_EQ(learned()->state(), state) << "learning twice from the same pictures";

  const auto different = make();
  const std::vector<cv::Mat> few = {drawn_picture(64, 32, 1000), drawn_picture(64, 32, 1001)};
  different->learn(few);
  EXPECT_NE(different->spec().name, encoder->spec().name) << "what it learned is part of the name";

  for (std::size_t cut : {std::size_t{0}, std::size_t{3}, state.size() / 2, state.size() - 1})
    EXPECT_THROW(make()->restore({state.data(), cut}), Error) << cut;
  Bytes flipped = state;
  flipped[flipped.size() / 2] ^= std::byte{4};
  EXPECT_THROW(make()->restore(flipped), Error);
}

TEST_P(EncoderContract, UnknownAndWrongParametersAreRefused) {
  EXPECT_THROW(make({{"no-such-parameter", 1}}), Error);
  for (const ParameterSpec& parameter : EncoderRegistry::instance().find("encoder", GetParam()).parameters) {
    EXPECT_THROW(make({{parameter.name, parameter.maximum + 1}}), Error) << parameter.name;
    if (parameter.minimum == parameter.default_value || parameter.name == "seconds") continue;  // a time changes none
    EXPECT_NE(make({{parameter.name, parameter.minimum}})->spec().name, make()->spec().name) << parameter.name;
  }
}

INSTANTIATE_TEST_SUITE_P(Encoders, EncoderContract, ::testing::ValuesIn(names()),
                         [](const auto& test) { return test.param; });

}  // namespace
}  // namespace citylearn::testing
