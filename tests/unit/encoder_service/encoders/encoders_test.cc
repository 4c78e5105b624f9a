// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>

#include "encoder_service/encoder_options.h"
#include "encoder_service/encoding/dense_sift.h"
#include "encoder_service/encoding/encoder.h"
#include "encoder_service/encoding/kmeans.h"
#include "encoder_service/encoding/reduction.h"
#include "tests/support/data/sample_pictures.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Eigen::MatrixXf;

std::unique_ptr<Encoder> make(const std::string& name, const std::map<std::string, double>& values = {}) {
  const auto& entry = EncoderRegistry::instance().find("encoder", name);
  return entry.create(Parameters(entry.name, entry.parameters, values), {});
}

MatrixXf encode(Encoder& encoder, const cv::Mat& picture) { return encoder.encode({&picture, 1}); }

/// Vertical stripes of the given period.
cv::Mat stripes(int width, int height, int period) {
  cv::Mat picture(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      picture.at<cv::Vec3b>(y, x) = cv::Vec3b::all(static_cast<uchar>(128 + 100 * std::sin(2 * CV_PI * x / period)));
  return picture;
}

/// Share of queries whose nearest reference is within `tolerance` frames.
double recall(const MatrixXf& reference, const MatrixXf& query, int tolerance) {
  const MatrixXf similarity = reference.transpose() * query;
  int right = 0;
  for (Eigen::Index i = 0; i < similarity.cols(); ++i) {
    Eigen::Index best;
    similarity.col(i).maxCoeff(&best);
    right += std::abs(best - i) <= tolerance;
  }
  return static_cast<double>(right) / static_cast<double>(similarity.cols());
}

TEST(Hog, StripesFillTheBinsOfTheirOrientation) {
  const auto hog = make("hog", {{"bins", 9}, {"contrast", 0}});
  const MatrixXf upright = encode(*hog, stripes(128, 64, 16));
  const MatrixXf lying = encode(*hog, stripes(64, 128, 16).t());
  ASSERT_EQ(upright.rows(), 3780);
  float along = 0, across = 0;
  for (Eigen::Index i = 0; i < upright.rows(); ++i) {
    const Eigen::Index bin = i % 9;
    // Gradients at 0 degrees lie between the last and the first bin, at 90 degrees in the middle one.
    (bin == 0 || bin == 8 ? along : across) += upright(i) * upright(i);
    if (bin != 4) {
      EXPECT_LT(lying(i), 1e-3f) << i;
    }
  }
  EXPECT_LT(across, 1e-3f * along);
}

TEST(Hog, BlocksHaveLengthOneAndLightDoesNotMatter) {
  const auto hog = make("hog");
  const cv::Mat picture = drawn_picture(128, 64, 3);
  const MatrixXf descriptor = encode(*hog, picture);
  ASSERT_EQ(descriptor.rows(), 15 * 7 * 4 * 12 * 2);
  for (Eigen::Index block = 0; block < 15 * 7 * 2; ++block)
    EXPECT_NEAR(descriptor.col(0).segment(block * 48, 48).norm(), 1, 0.01) << block;
  cv::Mat darker;
  picture.convertTo(darker, -1, 0.5, 20);
  const MatrixXf other = encode(*hog, darker), unlike = encode(*hog, drawn_picture(128, 64, 4));
  EXPECT_LT((descriptor - other).norm(), 0.3f * (descriptor - unlike).norm());
}

TEST(HogVlad, ItsCosineIsTheWeightedMeanOfBoth) {
  std::vector<cv::Mat> pictures;
  for (std::uint64_t i = 0; i < 6; ++i) pictures.push_back(drawn_picture(64, 32, i));
  const auto cosines = [&](const std::string& name, const std::map<std::string, double>& values = {}) -> MatrixXf {
    const auto encoder = make(name, values);
    encoder->learn(pictures);
    const MatrixXf descriptors = encoder->encode(pictures).colwise().normalized();
    return descriptors.transpose() * descriptors;
  };
  const MatrixXf hog = cosines("hog"), vlad = cosines("vlad");
  ASSERT_GT((hog - vlad).cwiseAbs().maxCoeff(), 0.1f);
  for (const float share : {0.f, 0.3f, 1.f}) {
    const MatrixXf joint = cosines("hog_vlad", {{"vlad-share", share}});
    EXPECT_LT((joint - (1 - share) * hog - share * vlad).cwiseAbs().maxCoeff(), 1e-5f) << share;
  }
}

TEST(PatchNorm, PatchesHaveMeanZeroAndDeviationOne) {
  const auto encoder = make("patchnorm");
  const MatrixXf descriptor = encode(*encoder, drawn_picture(64, 32, 8));
  const Eigen::Map<const Eigen::Matrix<float, 32, 64, Eigen::RowMajor>> pixels(descriptor.data());
  for (int y = 0; y < 32; y += 8)
    for (int x = 0; x < 64; x += 8) {
      EXPECT_NEAR((pixels.block<8, 8>(y, x).mean()), 0, 1e-4);
      EXPECT_NEAR((pixels.block<8, 8>(y, x).squaredNorm()), 64, 0.1);
    }
}

TEST(Raw84, GivesRedGreenBlueRowByRow) {
  cv::Mat picture(84, 84, CV_8UC3, cv::Scalar(0, 51, 255));
  picture.at<cv::Vec3b>(0, 1) = {255, 0, 0};
  const MatrixXf pixels = encode(*make("raw84", {{"sigma", 0}}), picture);
  ASSERT_EQ(pixels.rows(), 21168);
  EXPECT_FLOAT_EQ(pixels(0), 1);
  EXPECT_FLOAT_EQ(pixels(1), 0.2f);
  EXPECT_FLOAT_EQ(pixels(2), 0);
  EXPECT_FLOAT_EQ(pixels(3), 0);
  EXPECT_FLOAT_EQ(pixels(5), 1);
}

TEST(Raw84, RecommendsItsPixelsAsTheyAre) {
  const ReductionOptions defaults;
  ReductionOptions reduction = defaults;
  EXPECT_EQ(take_recommended("hog_vlad", reduction, false, false), "");
  EXPECT_EQ(reduction.dimension, defaults.dimension);
  EXPECT_EQ(reduction.centring, defaults.centring);
  EXPECT_EQ(take_recommended("raw84", reduction, false, false), "");
  EXPECT_TRUE(reduction.keeps_all());
  EXPECT_EQ(take_recommended("raw84", reduction, true, true), "") << "given as recommended";
  // What was given stays, with a warning.
  reduction = defaults;
  reduction.dimension = 0;
  const std::string warning = take_recommended("raw84", reduction, true, true);
  EXPECT_EQ(warning,
            "encoder raw84 recommends --centring none --dimension 0, not --dimension 0 --centring running: a network "
            "that learns to see may learn nothing from such features; leave these options out");
  EXPECT_EQ(reduction.centring, Centring::kRunning);
  EXPECT_TRUE(contains(list_encoders(), "recommends --centring none --dimension 0"));
}

TEST(Raw84, LightAndTintMakeLittleDifference) {
  cv::Mat picture(84, 84, CV_8UC3), tinted;
  cv::randu(picture, 40, 200);
  cv::GaussianBlur(picture, picture, {}, 2);
  picture.convertTo(picture, CV_8UC3, 2, -120);
  cv::multiply(picture, cv::Scalar(0.6, 0.8, 1.1), tinted);
  const MatrixXf pixels = encode(*make("raw84"), picture), same = encode(*make("raw84"), tinted);
  EXPECT_GT(pixels.minCoeff(), -1e-6);
  EXPECT_LT(pixels.maxCoeff(), 1 + 1e-6);
  EXPECT_NEAR(pixels.mean(), 0.5, 0.02);
  EXPECT_LT((pixels - same).norm() / (pixels.array() - 0.5).matrix().norm(), 0.15);
  const std::map<std::string, double> as_they_are = {{"sigma", 0}};
  const MatrixXf plain = encode(*make("raw84", as_they_are), picture);
  EXPECT_GT((plain - encode(*make("raw84", as_they_are), tinted)).norm() / (plain.array() - 0.5).matrix().norm(), 0.5);
}

TEST(DenseSift, GridOrientationAndLength) {
  cv::Mat grey;
  cv::cvtColor(stripes(48, 40, 8), grey, cv::COLOR_BGR2GRAY);
  grey.convertTo(grey, CV_32F);
  const LocalDescriptors local = dense_root_sift(grey, {.step = 4, .bin = 8});
  ASSERT_EQ(local.values.cols(), 5 * 3);
  EXPECT_EQ(local.centres.front(), cv::Point2f(16, 16));
  EXPECT_EQ(local.centres.back(), cv::Point2f(32, 24));
  for (const auto& descriptor : local.values.colwise()) {
    EXPECT_NEAR(descriptor.norm(), 1, 1e-3);
    // Light to dark and dark to light: orientations 0 and 4 of 8, nothing else.
    for (Eigen::Index i = 0; i < 128; ++i) {
      if (i % 4 != 0) {
        EXPECT_LT(descriptor(i), 0.05f) << i;
      }
    }
  }
  const LocalDescriptors flat = dense_root_sift(cv::Mat(32, 32, CV_32F, cv::Scalar(7)), {});
  EXPECT_EQ(flat.values.norm(), 0);
}

TEST(DenseSift, MovesWithThePicture) {
  cv::Mat grey;
  cv::cvtColor(drawn_picture(72, 72, 5), grey, cv::COLOR_BGR2GRAY);
  grey.convertTo(grey, CV_32F);
  // Two windows four pixels apart, read away from their borders, share descriptors.
  const LocalDescriptors one = dense_root_sift(grey(cv::Rect(0, 0, 64, 64)), {.step = 4, .bin = 4});
  const LocalDescriptors two = dense_root_sift(grey(cv::Rect(4, 0, 64, 64)), {.step = 4, .bin = 4});
  const Eigen::Index across = (64 - 16) / 4 + 1, middle = 6 * across + 6;
  EXPECT_LT((one.values.col(middle + 1) - two.values.col(middle)).norm(), 1e-3f);
  EXPECT_GT((one.values.col(middle) - two.values.col(middle)).norm(), 0.05f);
}

TEST(KMeans, FindsClustersAndRepeats) {
  Random random{5};
  MatrixXf points(2, 300);
  for (int i = 0; i < 300; ++i)
    points.col(i) << static_cast<float>(10 * (i % 3) + random.normal()), static_cast<float>(random.normal());
  const MatrixXf centres = kmeans(points, 3, 20, 1);
  EXPECT_EQ(centres, kmeans(points, 3, 20, 1));
  for (int cluster = 0; cluster < 3; ++cluster)
    EXPECT_LT((centres.colwise() - Eigen::Vector2f(10.f * static_cast<float>(cluster), 0)).colwise().norm().minCoeff(),
              0.5f);
  EXPECT_TRUE(kmeans(MatrixXf::Ones(4, 2), 5, 3, 1).allFinite()) << "fewer points than centres";
}

TEST(Nordland, HogFindsWinterInSummer) {
  const std::vector<cv::Mat> summer = nordland("summer", 10), winter = nordland("winter", 10);
  if (summer.empty()) GTEST_SKIP() << "no nordland-64x32 in the shared data";
  ASSERT_EQ(summer.size(), winter.size());
  const auto hog = make("hog");
  const MatrixXf reference = hog->encode(summer), query = hog->encode(winter);
  const auto found = [&](const ReductionOptions& options) {
    const Reduction reduction = Reduction::learn(reference, options);
    return recall(reduction.apply(reference), reduction.apply(query), 2);
  };
  const double centred = found({.centring = Centring::kRunning, .dimension = 0});
  EXPECT_GE(centred, 0.74);
  EXPECT_GE(centred, found({.centring = Centring::kNone, .dimension = 0}) + 0.05);
  EXPECT_GE(found({.centring = Centring::kRunning, .dimension = 64}), 0.6);
}

TEST(Nordland, TheDefaultFindsWinterInSummer) {
  const std::vector<cv::Mat> summer = nordland("summer", 10), winter = nordland("winter", 10);
  if (summer.empty()) GTEST_SKIP() << "no nordland-64x32 in the shared data";
  const auto encoder = make(kDefaultEncoder);
  encoder->learn(nordland("summer", 40));
  const MatrixXf reference = encoder->encode(summer), query = encoder->encode(winter);
  const Reduction reduction = Reduction::learn(reference, {});
  const double found = recall(reduction.apply(reference), reduction.apply(query), 2);
  RecordProperty("found", std::to_string(found));
  EXPECT_GE(found, 0.6) << "of 64 numbers, like hog's";
}

TEST(Nordland, SpatialVladFindsWinterInSummer) {
  const std::vector<cv::Mat> summer = nordland("summer", 10), winter = nordland("winter", 10);
  if (summer.empty()) GTEST_SKIP() << "no nordland-64x32 in the shared data";
  const auto vlad = make("vlad_spatial");
  vlad->learn(nordland("summer", 40));
  const MatrixXf reference = vlad->encode(summer), query = vlad->encode(winter);
  const Reduction reduction = Reduction::learn(reference, {.centring = Centring::kOwn, .dimension = 0});
  EXPECT_GE(recall(reduction.apply(reference), reduction.apply(query), 2), 0.55);
}

TEST(Nordland, VladWithstandsAShiftBetterThanHog) {
  const std::vector<cv::Mat> summer = nordland("summer", 20);
  if (summer.empty()) GTEST_SKIP() << "no nordland-64x32 in the shared data";
  // A camera turned aside: the query sees a window a fifth of its width further to the right.
  std::vector<cv::Mat> left, right;
  for (const cv::Mat& picture : summer) {
    left.push_back(picture(cv::Rect(0, 0, 52, 32)));
    right.push_back(picture(cv::Rect(12, 0, 52, 32)));
  }
  const auto found = [&](const std::string& name) {
    const auto encoder = make(name);
    if (encoder->training_sample_count() > 0) encoder->learn(left);
    const MatrixXf reference = encoder->encode(left), query = encoder->encode(right);
    const Reduction reduction = Reduction::learn(reference, {.centring = Centring::kOwn, .dimension = 0});
    return recall(reduction.apply(reference), reduction.apply(query), 0);
  };
  const double vlad = found("vlad"), hog = found("hog"), joint = found("hog_vlad");
  RecordProperty("vlad", std::to_string(vlad));
  RecordProperty("hog", std::to_string(hog));
  RecordProperty("hog_vlad", std::to_string(joint));
  EXPECT_GT(vlad, hog + 0.2) << "vlad " << vlad << ", hog " << hog;
  EXPECT_GT(joint, vlad - 0.1) << "vlad " << vlad << ", hog_vlad " << joint;
}

}  // namespace
}  // namespace citylearn::testing
