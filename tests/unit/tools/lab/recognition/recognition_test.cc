// SPDX-License-Identifier: Apache-2.0
// Similarity, ground truth, recall, precision-recall, intervals, hubness correction, the classifier.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/util/error.h"
#include "core/util/random.h"
#include "tools/lab/recognition/classifier.h"
#include "tools/lab/recognition/evaluation.h"
#include "tools/lab/recognition/similarity.h"

namespace citylearn {
namespace {

Eigen::MatrixXf noise(int rows, int columns, std::uint64_t seed) {
  Random random(seed);
  Eigen::MatrixXf matrix(rows, columns);
  for (Eigen::Index i = 0; i < matrix.size(); ++i) matrix.data()[i] = static_cast<float>(random.normal());
  return matrix;
}

TEST(Similarity, CosineIgnoresLengthAndZerosAreFarFromAll) {
  const Eigen::MatrixXf reference = (Eigen::MatrixXf(2, 3) << 1, 0, 0, 0, 2, 0).finished();
  const Eigen::MatrixXf query = (Eigen::MatrixXf(2, 2) << 3, -1, 3, 0).finished();
  const Eigen::MatrixXf found = similarity(reference, query, Measure::kCosine).matrix();
  const float half = std::sqrt(0.5f);
  const Eigen::MatrixXf expected = (Eigen::MatrixXf(3, 2) << half, -1, half, 0, 0, 0).finished();
  EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(Similarity, L1IsMinusTheSumOfDifferences) {
  const Eigen::MatrixXf reference = noise(5, 37, 1), query = noise(5, 21, 2);
  const Eigen::MatrixXf found = similarity(reference, query, Measure::kL1).matrix();
  for (int r = 0; r < 37; ++r)
    for (int q = 0; q < 21; ++q)
      ASSERT_NEAR(found(r, q), -(reference.col(r) - query.col(q)).cwiseAbs().sum(), 1e-4) << r << " " << q;
}

TEST(Similarity, RefusesUnequalDimensionsAndUnknownMeasures) {
  EXPECT_THROW(similarity(noise(3, 2, 1), noise(4, 2, 1), Measure::kCosine), Error);
  EXPECT_EQ(measure_of("cosine"), Measure::kCosine);
  EXPECT_EQ(measure_of("l1"), Measure::kL1);
  EXPECT_THROW(measure_of("cosin"), Error);
}

TEST(Csls, ByHand) {
  const Eigen::MatrixXf similarity = (Eigen::MatrixXf(2, 2) << 0.9f, 0.8f, 0.1f, 0.7f).finished();
  const Eigen::MatrixXf found = csls(similarity, 1).matrix();
  // Means over one neighbour: of the references .9 and .7, of the queries .9 and .8.
  const Eigen::MatrixXf expected = (Eigen::MatrixXf(2, 2) << 0.0f, -0.1f, -1.4f, -0.1f).finished();
  EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_THROW(csls(similarity, 0), Error);
}

TEST(Csls, TakesAHubItsAnswers) {
  // Noisy copies, and a reference frame that is near to everything.
  Eigen::MatrixXf reference = noise(16, 60, 3);
  const Eigen::MatrixXf query = (reference + 0.8f * noise(16, 60, 4)).array() + 1.2f;
  reference.col(0).setOnes();
  const GroundTruth truth = GroundTruth::by_index(60, 60, 0);
  const Scores plain = similarity(reference, query, Measure::kCosine);
  const Answers before = answers(plain, truth), after = answers(csls(plain), truth);
  const auto hubbed = [](const Answers& a) { return std::count(a.nearest.begin(), a.nearest.end(), 0); };
  EXPECT_GT(hubbed(before), 15);
  EXPECT_LT(hubbed(after), hubbed(before) / 2);
  EXPECT_GT(recall_at(after, 1), recall_at(before, 1) + 0.1);
}

TEST(GroundTruth, IndexMatchesAndTolerance) {
  const GroundTruth index = GroundTruth::by_index(10, 12, 2);
  EXPECT_EQ(index.right_frames(5), (std::vector<int>{3, 4, 5, 6, 7}));
  EXPECT_EQ(index.right_frames(9), (std::vector<int>{7, 8, 9}));
  EXPECT_TRUE(index.answerable(9));
  EXPECT_FALSE(index.answerable(10));
  const GroundTruth matches = GroundTruth::by_matches({{8, 0}, {1, 0}}, 10, 2, 1);
  EXPECT_EQ(matches.right_frames(0), (std::vector<int>{0, 1, 2, 7, 8, 9}));
  EXPECT_EQ(GroundTruth::by_matches({{3, 0}, {4, 0}}, 10, 1, 1).right_frames(0), (std::vector<int>{2, 3, 4, 5}));
  EXPECT_FALSE(matches.answerable(1));
  EXPECT_EQ(matches.place(0), 8);
  EXPECT_EQ(matches.place(1), -1);
  EXPECT_THROW(GroundTruth::by_matches({{10, 0}}, 10, 2, 1), Error);
  EXPECT_THROW(GroundTruth::by_index(10, 10, -1), Error);
}

TEST(Recall, CountsWrongFramesBeforeTheFirstRightOne) {
  Eigen::MatrixXf similarity(4, 3);
  similarity.col(0) << 0.9f, 0.1f, 0.2f, 0.3f;  // right at once
  similarity.col(1) << 0.9f, 0.5f, 0.6f, 0.1f;  // right frame third
  similarity.col(2) << 0.5f, 0.5f, 0.5f, 0.5f;  // all equal: three wrong ones come first
  const Answers found = answers(similarity, GroundTruth::by_index(4, 3, 0));
  EXPECT_EQ(found.rank, (std::vector<int>{0, 2, 3}));
  EXPECT_NEAR(recall_at(found, 1), 1 / 3.0, 1e-12);
  EXPECT_NEAR(recall_at(found, 2), 1 / 3.0, 1e-12);
  EXPECT_NEAR(recall_at(found, 3), 2 / 3.0, 1e-12);
  EXPECT_NEAR(recall_at(found, 4), 1, 1e-12);
  GroundTruth without_second = GroundTruth::by_index(4, 3, 0);
  without_second.leave_out(1);
  EXPECT_EQ(answers(similarity, without_second).nearest, (std::vector<int>{0, -1, 0}));
  EXPECT_EQ(recall_at(answers(similarity, without_second), 1), 0.5);
  EXPECT_THROW(answers(similarity, GroundTruth::by_index(3, 3, 0)), Error);
}

TEST(Recall, NoAnswerIsNoRecallAndQueriesWithoutTruthAreLeftOut) {
  const float none = -std::numeric_limits<float>::infinity();
  Eigen::MatrixXf similarity = Eigen::MatrixXf::Identity(2, 3);
  similarity.col(1).setConstant(none);
  similarity(0, 2) = std::numeric_limits<float>::quiet_NaN();
  const Answers found = answers(similarity, GroundTruth::by_index(2, 3, 0));
  EXPECT_EQ(found.nearest, (std::vector<int>{0, -1, 1}));
  EXPECT_EQ(found.rank[1], Answers::kNever);
  EXPECT_NEAR(recall_at(found, 5), 0.5, 1e-12);
  // The third query has no true place; its answer, as sure as the right one or less, can only cost precision.
  const PrecisionRecall curve = precision_recall(found);
  EXPECT_EQ(curve.recall.back(), 0.5);
  EXPECT_EQ(curve.precision.back(), 0.5);
}

/// Answers with these confidences, right or wrong.
Answers made(const std::vector<std::pair<float, bool>>& list) {
  Answers answers;
  for (const auto& [confidence, right] : list) {
    answers.nearest.push_back(0);
    answers.confidence.push_back(confidence);
    answers.rank.push_back(right ? 0 : 1);
    answers.answerable.push_back(true);
  }
  return answers;
}

TEST(PrecisionRecallCurve, ByHand) {
  const PrecisionRecall curve = precision_recall(made({{0.6f, true}, {0.9f, true}, {0.7f, false}, {0.1f, false}}));
  EXPECT_EQ(curve.precision, (std::vector<double>{1, 0.5, 2 / 3.0, 0.5}));
  EXPECT_EQ(curve.recall, (std::vector<double>{0.25, 0.25, 0.5, 0.5}));
  EXPECT_NEAR(curve.auc, 0.25 * 1 + 0.25 * (0.5 + 2 / 3.0) / 2, 1e-12);
  EXPECT_EQ(curve.recall_at_full_precision, 0.25);
}

TEST(PrecisionRecallCurve, EqualConfidencesAreOneThreshold) {
  const auto right_first = precision_recall(made({{0.5f, true}, {0.5f, false}}));
  const auto wrong_first = precision_recall(made({{0.5f, false}, {0.5f, true}}));
  EXPECT_EQ(right_first.confidence.size(), 1u);
  EXPECT_EQ(right_first.auc, wrong_first.auc);
  EXPECT_NEAR(right_first.auc, 0.25, 1e-12);
  EXPECT_EQ(right_first.recall_at_full_precision, 0);
}

TEST(PrecisionRecallCurve, Ends) {
  EXPECT_EQ(precision_recall(made({{1, true}, {2, true}})).auc, 1);
  EXPECT_EQ(precision_recall(made({{1, false}, {2, false}})).auc, 0);
  EXPECT_EQ(precision_recall({}).auc, 0);
}

TEST(Intervals, WilsonAsPublished) {
  // Newcombe, Statistics in Medicine 17 (1998), table I, method 3.
  const auto near = [](Interval interval, double low, double high) {
    EXPECT_NEAR(interval.low, low, 5e-5);
    EXPECT_NEAR(interval.high, high, 5e-5);
  };
  near(wilson_interval(81, 263), 0.2553, 0.3662);
  near(wilson_interval(15, 148), 0.0624, 0.1605);
  near(wilson_interval(0, 20), 0, 0.1611);
  near(wilson_interval(29, 29), 0.8830, 1);
}

TEST(Intervals, AucHoldsTheTruthAndRepeats) {
  Random random(5);
  // Right with probability c: sure answers are right more often.
  const auto draw = [&] {
    std::vector<std::pair<float, bool>> list;
    for (int i = 0; i < 400; ++i) {
      const double c = random.uniform();
      list.push_back({static_cast<float>(c), random.uniform() < c});
    }
    return made(list);
  };
  double mean = 0;
  for (int i = 0; i < 200; ++i) mean += precision_recall(draw()).auc / 200;
  int inside = 0;
  for (int i = 0; i < 60; ++i) {
    const Interval interval = auc_interval(draw(), static_cast<std::uint64_t>(i), 200);
    inside += interval.low <= mean && mean <= interval.high;
  }
  EXPECT_GE(inside, 50);  // of 60; blocks make it a little narrow
  const Answers some = draw();
  EXPECT_EQ(auc_interval(some, 1).low, auc_interval(some, 1).low);
  EXPECT_NE(auc_interval(some, 1).low, auc_interval(some, 2).low);
}

TEST(FrameClassifier, LearnsItsFramesAndKnowsNoisyCopies) {
  const Eigen::MatrixXf reference = noise(32, 100, 6).colwise().normalized();
  const FrameClassifier classifier(reference, {.epochs = 150});
  const GroundTruth truth = GroundTruth::by_index(100, 100, 0);
  const Eigen::MatrixXf own = classifier.probabilities(reference);
  EXPECT_LT((own.colwise().sum().array() - 1).abs().maxCoeff(), 1e-4);
  EXPECT_GE(recall_at(answers(own, truth), 1), 0.97);
  const Eigen::MatrixXf copy = reference + 0.08f * noise(32, 100, 7);
  EXPECT_GT(recall_at(answers(classifier.probabilities(copy), truth), 1), 0.85);
  const Eigen::MatrixXf strangers = noise(32, 100, 8).colwise().normalized();
  EXPECT_LT(recall_at(answers(classifier.probabilities(strangers), truth), 1), 0.1);
}

TEST(FrameClassifier, SameSeedSameNumbers) {
  const Eigen::MatrixXf reference = noise(8, 20, 9);
  const auto learn = [&](std::uint64_t seed) {
    return FrameClassifier(reference, {.hidden = 16, .epochs = 5, .seed = seed}).probabilities(reference);
  };
  EXPECT_EQ(learn(1), learn(1));
  EXPECT_NE(learn(1), learn(2));
  EXPECT_THROW(FrameClassifier(Eigen::MatrixXf(4, 0), {}), Error);
  EXPECT_THROW(FrameClassifier(reference, {.hidden = 0}), Error);
  EXPECT_THROW(FrameClassifier(reference, {.epochs = 1}).probabilities(noise(9, 2, 1)), Error);
}

}  // namespace
}  // namespace citylearn
