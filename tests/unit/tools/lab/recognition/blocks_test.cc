// SPDX-License-Identifier: Apache-2.0
// Scores that are computed a block at a time: the same as those computed at once, in memory that hardly grows with
// them.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "core/util/random.h"
#include "tools/lab/recognition/methods.h"
#include "tools/lab/recognition/sequence.h"

namespace citylearn::lab {
namespace {

/// Features of a walk, and noisy ones of the same places: neighbouring frames are alike.
std::pair<Eigen::MatrixXf, Eigen::MatrixXf> walk(int references, int queries, int dimension) {
  Random random(11);
  const auto normal = [&] { return static_cast<float>(random.normal()); };
  Eigen::MatrixXf reference(dimension, references), query(dimension, queries);
  for (Eigen::Index i = 0; i < reference.size(); ++i)
    reference.data()[i] = normal() + (i < dimension ? 0 : 0.9f * reference.data()[i - dimension]);
  for (Eigen::Index i = 0; i < query.size(); ++i)
    query.data()[i] = normal() + (i < reference.size() ? reference.data()[i] : 0);
  return {reference, query};
}

TEST(Blocks, AreTheSameHoweverTheyAreCut) {
  // No multiples of what a kernel takes at once.
  const auto [reference, query] = walk(1003, 901, 24);
  const std::map<std::string, Scores> all = {
      {"cosine", similarity(reference, query, Measure::kCosine)},
      {"l1", similarity(reference, query, Measure::kL1)},
      {"sequence",
       sequence_similarity(similarity(reference, query, Measure::kCosine), {.slowest = 0.7, .fastest = 1.4})},
      {"past of csls",
       sequence_similarity(csls(similarity(reference, query, Measure::kCosine)), {.length = 6, .causal = true})}};
  for (const auto& [name, scores] : all) {
    Eigen::MatrixXf whole(scores.references(), scores.queries());
    scores.read(0, 0, whole);
    EXPECT_EQ(scores.matrix(), whole) << name;
    for (const auto& [r, q, rows, columns] : std::vector<std::array<int, 4>>{
             {0, 0, 1, 1}, {48, 48, 48, 48}, {37, 11, 700, 3}, {955, 850, 48, 51}, {500, 0, 7, 901}}) {
      Eigen::MatrixXf block(rows, columns);
      scores.read(r, q, block);
      EXPECT_EQ(block, whole.block(r, q, rows, columns)) << name << " from " << r << ", " << q;
    }
  }
}

/// The methods by their formulas, of all similarities at once.
Eigen::MatrixXd contrast_at_once(const Eigen::MatrixXd& difference) {
  Eigen::MatrixXd contrast(difference.rows(), difference.cols());
  for (Eigen::Index q = 0; q < difference.cols(); ++q)
    for (Eigen::Index r = 0; r < difference.rows(); ++r) {
      const Eigen::Index from = std::max<Eigen::Index>(0, r - 5), to = std::min(difference.rows(), r + 6);
      const Eigen::ArrayXd around = difference.col(q).segment(from, to - from);
      const double squares = (around - around.mean()).square().sum();
      contrast(r, q) = (difference(r, q) - around.mean()) / std::sqrt(squares / static_cast<double>(around.size() - 1));
    }
  return contrast.array() - contrast.minCoeff();
}

Eigen::MatrixXf diagonal_mean_at_once(const Eigen::MatrixXf& scores) {
  Eigen::MatrixXf mean(scores.rows(), scores.cols());
  for (Eigen::Index q = 0; q < scores.cols(); ++q)
    for (Eigen::Index r = 0; r < scores.rows(); ++r) {
      float sum = 0, count = 0;
      for (Eigen::Index k = -10; k <= 10; ++k)
        if (r + k >= 0 && r + k < scores.rows() && q + k >= 0 && q + k < scores.cols())
          sum += scores(r + k, q + k), ++count;
      mean(r, q) = sum / count;
    }
  return mean;
}

TEST(Blocks, MethodsGiveTheFiguresOfAllSimilaritiesAtOnce) {
  const auto [reference, query] = walk(630, 611, 16);
  const GroundTruth truth = GroundTruth::by_index(630, 611, 2);
  const Eigen::MatrixXf plain = similarity(reference, query, Measure::kCosine).matrix();
  const Eigen::MatrixXd contrast = contrast_at_once(-plain.cast<double>());
  const SeqSlam slam = seqslam(contrast, {.length = 20});
  Answers by_costs = answers(Eigen::MatrixXf(-slam.costs.cast<float>()), truth);
  for (int q = 10; q < 601; ++q) by_costs.confidence[q] = static_cast<float>(-slam.ratios[q]);
  const std::map<std::string, Answers> expected = {
      {"nearest", answers(plain, truth)},
      {"contrast+sequence", answers(diagonal_mean_at_once(-contrast.cast<float>()), truth)},
      {"csls+sequence", answers(diagonal_mean_at_once(csls(plain).matrix()), truth)},
      {"seqslam", by_costs}};
  for (const auto& [name, all] : expected) {
    const Answers found = Method(name).run(reference, query, truth, {}).answers;
    EXPECT_EQ(found.nearest, all.nearest) << name;
    EXPECT_EQ(found.rank, all.rank) << name;
    EXPECT_EQ(precision_recall(found).auc, precision_recall(all).auc) << name;
  }
}

TEST(Blocks, TheOverviewKeepsTheGreatestScores) {
  const auto [reference, query] = walk(50, 41, 8);
  const auto result = Method("nearest").run(reference, query, GroundTruth::by_index(50, 41, 2), {.overview = 20});
  const Eigen::MatrixXf plain = similarity(reference, query, Measure::kCosine).matrix();
  ASSERT_EQ(result.overview.rows(), 17);  // three frames a pixel
  ASSERT_EQ(result.overview.cols(), 14);
  EXPECT_EQ(result.overview(3, 4), plain.block(9, 12, 3, 3).maxCoeff());
  EXPECT_EQ(result.overview(16, 13), plain.block(48, 39, 2, 2).maxCoeff());
}

double peak_mb() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024;
}

TEST(Blocks, NoMethodHoldsAllSimilarities) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "skipped: sanitizers hold freed memory back";
#endif
  constexpr int kFrames = 7000;  // similarities of 196 MB
  const auto [reference, query] = walk(kFrames, kFrames, 8);
  const GroundTruth truth = GroundTruth::by_index(kFrames, kFrames, 2);
  for (const char* name : {"nearest", "csls", "contrast+sequence", "seqslam"})
    EXPECT_EXIT(
        {
          const double before = peak_mb();
          Method(name).run(reference, query, truth, {.overview = 512});
          std::fprintf(stderr, "%.0f MB more", peak_mb() - before);
          std::_Exit(peak_mb() - before < 180 ? 0 : 1);
        },
        ::testing::ExitedWithCode(0), "MB more")
        << name;
}

}  // namespace
}  // namespace citylearn::lab
