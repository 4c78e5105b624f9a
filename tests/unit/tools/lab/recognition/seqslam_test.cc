// SPDX-License-Identifier: Apache-2.0
// Sequence matching, against the published results of an OpenSeqSLAM port on Nordland (spring reference, winter query).
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/util/random.h"
#include "tests/paths.h"
#include "tests/support/data/real_data.h"
#include "tools/lab/recognition/evaluation.h"
#include "tools/lab/recognition/sequence.h"

namespace citylearn::testing {
namespace {

/// Returns the contrast as SeqSLAM takes it: the least is 0.
Eigen::MatrixXd enhanced_by(int window, Eigen::MatrixXd difference) {
  for (auto column : difference.colwise()) column = local_contrast(column, window).eval();
  return difference.array() - difference.minCoeff();
}

class Golden : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = testing::real_data(CITYLEARN_SOURCE_DIR, "seqslam-golden");
    if (folder_.empty()) GTEST_SKIP() << "skipped: no results of the port; CITYLEARN_DATA names their folder";
  }
  /// Returns the one matrix of doubles that a MATLAB v5 file holds, uncompressed: its values are the end of the file.
  Eigen::MatrixXd read(const std::string& name) const {
    const std::string file = read_file(folder_ + "/" + name + "-spring-1-100-35601-winter-1-100-35601.mat");
    std::int32_t sizes[2];
    std::memcpy(sizes, file.data() + 160, sizeof sizes);
    Eigen::MatrixXd matrix(sizes[0], sizes[1]);
    const std::size_t bytes = static_cast<std::size_t>(matrix.size()) * sizeof(double);
    std::memcpy(matrix.data(), file.data() + file.size() - bytes, bytes);
    return matrix;
  }
  std::string folder_;
};

TEST_F(Golden, LocalContrast) {
  const Eigen::MatrixXd enhanced = enhanced_by(10, read("difference"));
  const Eigen::MatrixXd expected = read("differenceEnhanced");
  EXPECT_LT((enhanced - expected).cwiseAbs().maxCoeff(), 1e-9);
}

TEST_F(Golden, Matches) {
  const Eigen::MatrixXd expected = read("matches");
  const SeqSlam found = seqslam(read("differenceEnhanced"), {});
  ASSERT_EQ(expected.rows(), found.matches.size());
  int matched = 0, near = 0;
  for (Eigen::Index q = 0; q < expected.rows(); ++q) {
    const bool any = std::isfinite(expected(q, 0));
    ASSERT_EQ(found.matches[q], any ? static_cast<int>(expected(q, 0)) : -1) << q;
    matched += any;
    near += any && std::abs(found.matches[q] - q) <= 2;
    if (any) {
      ASSERT_NEAR(found.ratios[q], expected(q, 1), 1e-9) << q;
    }
  }
  EXPECT_EQ(matched, 347);
  EXPECT_EQ(near, 303);  // 87.3 %
}

TEST_F(Golden, SequencesOfSimilaritySeeWhatSingleFramesDoNot) {
  const Eigen::MatrixXf single = (-read("differenceEnhanced")).cast<float>();
  const GroundTruth truth = GroundTruth::by_index(357, 357, 2);
  const double alone = recall_at(answers(single, truth), 1);
  const double sequence = recall_at(answers(sequence_similarity(single, {}), truth), 1);
  EXPECT_LT(alone, 0.25);
  EXPECT_GT(sequence, 0.9);
}

TEST(LocalContrast, IsMeanAndDeviationOfTheReferenceFramesAround) {
  Eigen::MatrixXd difference(4, 1);
  difference << 1, 2, 6, 3;
  // Windows: {1,2}, {1,2,6}, {2,6,3}, {6,3}.
  const Eigen::VectorXd raw =
      (Eigen::VectorXd(4) << -std::sqrt(0.5), -1 / std::sqrt(7), (6 - 11.0 / 3) / std::sqrt(13.0 / 3), -std::sqrt(0.5))
          .finished();
  const Eigen::MatrixXd enhanced = enhanced_by(2, difference);
  EXPECT_LT((enhanced - (raw.array() - raw.minCoeff()).matrix()).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(LocalContrast, AConstantWindowHasNone) {
  EXPECT_EQ(local_contrast(Eigen::VectorXd::Constant(6, 5), 4), Eigen::VectorXd::Zero(6));
}

TEST(Sequence, MeanAlongTheDiagonalCutAtTheEdges) {
  const Eigen::MatrixXf similarity = (Eigen::MatrixXf(3, 3) << 1, 2, 3, 4, 5, 6, 7, 8, 9).finished();
  const Eigen::MatrixXf sequence = sequence_similarity(similarity, {.length = 3}).matrix();
  EXPECT_FLOAT_EQ(sequence(1, 1), 5);  // (1 + 5 + 9) / 3
  EXPECT_FLOAT_EQ(sequence(0, 0), 3);  // (1 + 5) / 2
  EXPECT_FLOAT_EQ(sequence(0, 2), 3);  // alone in its corner
  EXPECT_FLOAT_EQ(sequence(1, 0), (4 + 8) / 2.f);
  EXPECT_EQ(sequence_similarity(similarity, {.length = 1}).matrix(), similarity);
}

TEST(Sequence, ACausalOneSeesNothingOfLaterFrames) {
  Eigen::MatrixXf similarity = (Eigen::MatrixXf(3, 3) << 1, 2, 3, 4, 5, 6, 7, 8, 9).finished();
  const Eigen::MatrixXf past = sequence_similarity(similarity, {.length = 2, .causal = true}).matrix();
  EXPECT_FLOAT_EQ(past(1, 1), 3);  // (1 + 5) / 2
  EXPECT_FLOAT_EQ(past(2, 0), 7);  // nothing before it
  EXPECT_FLOAT_EQ(past(0, 2), 3);
  similarity.col(2).setConstant(100);
  EXPECT_EQ(sequence_similarity(similarity, {.length = 2, .causal = true}).matrix().leftCols(2), past.leftCols(2));
}

/// Noise, and a faint line from (first, 0) on that climbs by `velocity`: too faint to be seen in a single frame.
Eigen::MatrixXf faint_line(int rows, int columns, int first, double velocity) {
  Random random(7);
  Eigen::MatrixXf similarity(rows, columns);
  for (Eigen::Index i = 0; i < similarity.size(); ++i) similarity.data()[i] = static_cast<float>(random.normal());
  for (int q = 0; q < columns; ++q) similarity(first + static_cast<int>(std::lround(velocity * q)), q) += 2;
  return similarity;
}

TEST(Sequence, FindsALineAtAnotherVelocityWhenToldTheRange) {
  const Eigen::MatrixXf similarity = faint_line(300, 100, 20, 1.5);
  std::vector<std::pair<int, int>> line;
  for (int q = 0; q < 100; ++q) line.push_back({20 + static_cast<int>(std::lround(1.5 * q)), q});
  const GroundTruth truth = GroundTruth::by_matches(line, 300, 100, 2);
  const auto recall = [&](double slowest, double fastest) {
    return recall_at(
        answers(sequence_similarity(similarity, {.length = 21, .slowest = slowest, .fastest = fastest}), truth), 1);
  };
  EXPECT_LT(recall(1, 1), 0.5);
  EXPECT_GT(recall(1.5, 1.5), 0.9);
  EXPECT_GT(recall(1, 2), 0.85);
}

TEST(Sequence, SeqSlamFindsAFaintLineAndIsSurestThere) {
  const Eigen::MatrixXd difference = -faint_line(300, 100, 50, 1).cast<double>();
  const SeqSlam found = seqslam(enhanced_by(10, difference), {.length = 20});
  int right = 0;
  for (int q = 0; q < 100; ++q) {
    if (q < 10 || q >= 90) {
      EXPECT_EQ(found.matches[q], -1) << q;
      EXPECT_TRUE(std::isnan(found.ratios[q]));
    } else {
      right += std::abs(found.matches[q] - (50 + q)) <= 2;
      EXPECT_LE(found.ratios[q], 1);
    }
  }
  EXPECT_GE(right, 72);
}

TEST(Sequence, RefusesWhatIsNoSequence) {
  const Eigen::MatrixXf small = Eigen::MatrixXf::Zero(3, 3);
  EXPECT_THROW(sequence_similarity(small, {.length = 4}), Error);
  EXPECT_THROW(sequence_similarity(small, {.length = 3, .slowest = 2, .fastest = 1}), Error);
  EXPECT_THROW(sequence_similarity(small, {.length = 3, .slowest = 0}), Error);
  EXPECT_THROW(seqslam(small.cast<double>(), {.length = 3}), Error);
  EXPECT_THROW(seqslam(small.cast<double>(), {.fastest = std::numeric_limits<double>::quiet_NaN()}), Error);
  EXPECT_THROW(local_contrast(Eigen::VectorXd::Zero(3), 0), Error);
}

TEST(Sequence, LongerThanTheRecording) {
  const Eigen::MatrixXf same = Eigen::MatrixXf::Identity(5, 5);
  const GroundTruth truth = GroundTruth::by_index(5, 5, 0);
  EXPECT_EQ(recall_at(answers(sequence_similarity(same, {.length = 21}), truth), 1), 1);
  const SeqSlam none = seqslam(Eigen::MatrixXd::Zero(5, 5), {.length = 10});
  EXPECT_EQ(none.matches, Eigen::VectorXi::Constant(5, -1));
}

}  // namespace
}  // namespace citylearn::testing
