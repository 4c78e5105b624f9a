// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/reduction.h"

#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <cmath>

#include "core/util/error.h"
#include "core/util/random.h"
#include "tests/support/log.h"

namespace citylearn {
namespace {

using Eigen::MatrixXf;

/// Normal numbers whose row i has deviation 1 / (1 + i), about `middle`.
MatrixXf sample(int rows, int columns, float middle = 3, std::uint64_t seed = 1) {
  Random random{seed};
  MatrixXf result(rows, columns);
  for (Eigen::Index i = 0; i < result.size(); ++i)
    result.data()[i] = middle + static_cast<float>(random.normal() / static_cast<double>(1 + i % result.rows()));
  return result;
}

MatrixXf normalised(MatrixXf values) {
  values.colwise().normalize();
  return values;
}

TEST(Reduction, EqualDescriptorsOfTheReferenceAreTold) {
  const testing::Log log;
  Reduction::learn(sample(3, 4), {.dimension = 0});
  EXPECT_EQ(log.text(), "");
  Reduction::learn(MatrixXf::Ones(3, 4), {.dimension = 0});
  EXPECT_TRUE(log.has("all 4 descriptors of the reference are equal")) << log.text();
}

TEST(Reduction, CentringTakesTheRightMean) {
  const MatrixXf reference = sample(6, 40), query = sample(6, 30, 5, 2);
  const auto apply = [&](Centring centring) {
    return Reduction::learn(reference, {.centring = centring, .dimension = 0}).apply(query);
  };
  const Eigen::VectorXf mean = reference.rowwise().mean(), own = query.rowwise().mean();
  EXPECT_EQ(apply(Centring::kNone), query) << "pixels stay as they are";
  EXPECT_TRUE(apply(Centring::kReference).isApprox(normalised(query.colwise() - mean), 1e-4f));
  EXPECT_TRUE(apply(Centring::kOwn).isApprox(normalised(query.colwise() - own), 1e-4f));

  const MatrixXf running = apply(Centring::kRunning);
  const Eigen::VectorXf at4 = (20 * mean + query.leftCols(5).rowwise().sum()) / 25;
  EXPECT_TRUE(running.col(4).isApprox((query.col(4) - at4).normalized(), 1e-4f));
}

TEST(Reduction, RunningMeanWorksOnline) {
  const Reduction reduction = Reduction::learn(sample(30, 20), {.dimension = 5});
  const MatrixXf query = sample(30, 25, 4, 9), whole = reduction.apply(query);
  for (Eigen::Index n : {1, 7, 24})
    EXPECT_TRUE(reduction.apply(query.leftCols(n)).isApprox(whole.leftCols(n), 1e-4f)) << n;
}

TEST(Reduction, ALongTraversalIsReadInBlocksAndLearnedFromASample) {
  const MatrixXf all = sample(6, 2 * Reduction::kMaxSample + 10), every_other = all(Eigen::all, Eigen::seq(1, 8191, 2));
  const Eigen::VectorXf mean = all.rowwise().mean();
  const Reduction own = Reduction::learn(all, {.centring = Centring::kOwn, .dimension = 0});
  EXPECT_TRUE(own.apply(all).isApprox(normalised(all.colwise() - mean), 1e-4f));
  // Of 8,192 frames the middles of 4,096 parts are the odd ones.
  const Reduction learned = Reduction::learn(all.leftCols(8192), {.dimension = 3});
  const MatrixXf features = learned.apply(all);
  EXPECT_EQ(features, Reduction::learn(every_other, {.dimension = 3}).apply(all));
  OnlineReduction online(std::make_shared<Reduction>(learned));
  for (Eigen::Index i = 0; i < all.cols(); ++i)
    ASSERT_TRUE(online.apply(all.col(i)).isApprox(features.col(i), 1e-3f)) << i;
  EXPECT_EQ(Reduction::largest_dimension(10000, 5000), 4095);
  EXPECT_EQ(Reduction::largest_dimension(10000, 300), 299);
}

TEST(Reduction, OneByOneGivesWhatAllTogetherGive) {
  const MatrixXf query = sample(30, 25, 4, 9);
  for (const ReductionOptions& options : {ReductionOptions{.dimension = 5},
                                          {.centring = Centring::kReference, .dimension = 5},
                                          {.centring = Centring::kRunning, .dimension = 0},
                                          {.centring = Centring::kNone, .dimension = 0}}) {
    const auto reduction = std::make_shared<Reduction>(Reduction::learn(sample(30, 20), options));
    const MatrixXf whole = reduction->apply(query);
    OnlineReduction online(reduction);
    for (Eigen::Index i = 0; i < query.cols(); ++i)
      EXPECT_TRUE(online.apply(query.col(i)).isApprox(whole.col(i), 1e-4f)) << name_of(options.centring) << " " << i;
  }
}

TEST(Reduction, FeaturesHaveLengthOneAndTheMeanBecomesZeros) {
  const MatrixXf reference = sample(8, 50);
  const Reduction reduction = Reduction::learn(reference, {.centring = Centring::kReference, .dimension = 3});
  const MatrixXf features = reduction.apply(reference);
  EXPECT_EQ(features.rows(), 3);
  EXPECT_EQ(reduction.dimension(), 3);
  EXPECT_EQ(reduction.input_dimension(), 8);
  for (const auto& feature : features.colwise()) EXPECT_NEAR(feature.norm(), 1, 1e-5);
  const MatrixXf same = MatrixXf::Constant(4, 6, 2.5f);  // every frame is the mean
  const MatrixXf nothing = Reduction::learn(same, {.centring = Centring::kOwn, .dimension = 2}).apply(same);
  EXPECT_EQ(nothing, MatrixXf::Zero(2, 6));
}

/// PCA features before the length is taken away cannot be seen, but the cosines between them can.
void expect_pca(int rows, int columns, int dimension, double whitening) {
  const MatrixXf reference = sample(rows, columns, 3, 7);
  const MatrixXf features =
      Reduction::learn(reference, {.centring = Centring::kReference, .dimension = dimension, .whitening = whitening})
          .apply(reference);
  const Eigen::MatrixXd centred = (reference.colwise() - reference.rowwise().mean()).cast<double>();
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(centred, Eigen::ComputeThinU | Eigen::ComputeThinV);
  Eigen::MatrixXd expected = svd.matrixV().leftCols(dimension).transpose();
  for (int i = 0; i < dimension; ++i) expected.row(i) *= std::pow(svd.singularValues()[i], 1 - 2 * whitening);
  expected.colwise().normalize();
  const Eigen::MatrixXd cosines = features.cast<double>().transpose() * features.cast<double>();
  EXPECT_LT((cosines - expected.transpose() * expected).cwiseAbs().maxCoeff(), 5e-3) << rows << " x " << columns;
}

TEST(Reduction, PcaIsThatOfTheSingularValues) {
  expect_pca(12, 60, 5, 0);     // more frames than numbers
  expect_pca(12, 60, 12, 0.5);  // all axes, fully whitened
  expect_pca(12, 60, 1, 0.2);
  expect_pca(60, 20, 6, 0.2);  // the Gram matrix
  expect_pca(60, 20, 19, 0.5);
  expect_pca(80, 70, 4, 0.2);  // few of many: subspace iteration
}

TEST(Reduction, EqualFramesDoNotBlowUp) {
  MatrixXf reference = sample(50, 30);
  for (int i = 5; i < 30; ++i) reference.col(i) = reference.col(0);  // rank 5
  const Reduction reduction =
      Reduction::learn(reference, {.centring = Centring::kReference, .dimension = 20, .whitening = 0.5});
  EXPECT_LT(reduction.apply(reference).bottomRows(14).norm(), 1e-3f);
  EXPECT_TRUE(reduction.apply(sample(50, 4, 3, 5)).allFinite());
}

TEST(Reduction, RefusesWhatCannotBe) {
  const MatrixXf reference = sample(10, 8);
  const auto learn = [](const MatrixXf& from, int dimension, double whitening = 0.2) {
    return Reduction::learn(from, {.dimension = dimension, .whitening = whitening});
  };
  EXPECT_NO_THROW(learn(reference, 7));
  EXPECT_THROW(learn(reference, 8), Error);
  EXPECT_THROW(learn(reference, -1), Error);
  EXPECT_THROW(learn(reference, 2, -0.1), Error);
  EXPECT_THROW(learn(reference, 2, std::nan("")), Error);
  EXPECT_THROW(learn(MatrixXf(10, 0), 0), Error);
  MatrixXf broken = reference;
  broken(2, 2) = std::nanf("");
  EXPECT_THROW(learn(broken, 2), Error);
  EXPECT_THROW(learn(reference, 3).apply(sample(9, 2)), Error);
  EXPECT_EQ(centring_of("own"), Centring::kOwn);
  EXPECT_THROW(centring_of("mine"), Error);
}

TEST(Reduction, ComesBackFromBytesOrNotAtAll) {
  const MatrixXf query = sample(30, 9, 4, 3);
  for (int dimension : {0, 6}) {
    const Reduction reduction = Reduction::learn(sample(30, 20), {.dimension = dimension, .whitening = 0.3});
    const Bytes bytes = reduction.save("hog-1 bins=9");
    const Reduction again = Reduction::load(bytes, "hog-1 bins=9", "file");
    EXPECT_EQ(again.apply(query), reduction.apply(query));
    EXPECT_EQ(again.options().whitening, 0.3);
    EXPECT_EQ(again.options().dimension, dimension);
    EXPECT_THROW(Reduction::load(bytes, "hog-1 bins=12", "file"), Error);
    for (std::size_t cut = 0; cut < bytes.size(); cut += 3)
      EXPECT_THROW(Reduction::load({bytes.data(), cut}, "hog-1 bins=9", "file"), Error) << cut;
    for (std::size_t i = 0; i < bytes.size(); i += 5) {
      Bytes flipped = bytes;
      flipped[i] ^= std::byte{0x10};
      EXPECT_THROW(Reduction::load(flipped, "hog-1 bins=9", "file"), Error) << i;
    }
    Bytes longer = bytes;
    longer.push_back(std::byte{0});
    EXPECT_THROW(Reduction::load(longer, "hog-1 bins=9", "file"), Error);
  }
}

}  // namespace
}  // namespace citylearn
