// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/recognition/methods.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <utility>

#include "core/util/error.h"
#include "core/wire/service.h"
#include "tools/lab/descriptors.h"
#include "tools/lab/recognition/classifier.h"
#include "tools/lab/recognition/sequence.h"

namespace citylearn::lab {
namespace {

using Eigen::Index;

Scores classified(const Eigen::MatrixXf& reference, const Eigen::MatrixXf& query, const MatchingOptions& options) {
  const auto stop = [] { return stop_requested(); };
  const FrameClassifier classifier(
      reference, {.hidden = options.hidden, .epochs = options.epochs, .seed = options.seed, .stop = stop});
  return Scores(reference.cols(), query.cols(),
                [&query, classifier](Index r, Index q, Eigen::Ref<Eigen::MatrixXf> block) {
                  const FrameRange range = whole_kernels({q, block.cols()}, query.cols());
                  block = classifier.probabilities(query.middleCols(range.first, range.count))
                              .block(r, q - range.first, block.rows(), block.cols());
                });
}

/// Returns the scores; they end with Stopped when the program shall end.
Scores stoppable(Scores scores) {
  const Index references = scores.references(), queries = scores.queries();
  return Scores(references, queries, [scores = std::move(scores)](Index r, Index q, Eigen::Ref<Eigen::MatrixXf> block) {
    if (stop_requested()) throw Stopped{};
    scores.read(r, q, block);
  });
}

/// Returns SeqSLAM's contrast of minus the scores, of which `least` is the least.
Eigen::MatrixXd enhanced(const Eigen::MatrixXf& block, int window, double least) {
  Eigen::MatrixXd contrast(block.rows(), block.cols());
  for (Index q = 0; q < block.cols(); ++q)
    contrast.col(q) = local_contrast(-block.col(q).cast<double>(), window).array() - least;
  return contrast;
}

/// Keeps the greatest scores of `pixel` x `pixel` frames in mind.
void add_to_overview(Eigen::MatrixXf& overview, Index pixel, Index first,
                     const Eigen::Ref<const Eigen::MatrixXf>& block) {
  for (Index q = 0; q < block.cols(); ++q)
    for (Index r = 0; r < overview.rows(); ++r) {
      float& greatest = overview(r, (first + q) / pixel);
      const Index size = std::min(pixel, block.rows() - r * pixel);
      greatest = std::max(greatest, block.col(q).segment(r * pixel, size).maxCoeff());
    }
}

}  // namespace

Method::Method(const std::string& chain) : name_(chain) {
  std::stringstream text(chain);
  const std::string known = "nearest or mlp, then csls, contrast, sequence, past, seqslam, joined by +";
  for (std::string step; std::getline(text, step, '+');) {
    const bool source = step == "nearest" || step == "mlp";
    if (!source && step != "csls" && step != "contrast" && step != "sequence" && step != "past" && step != "seqslam")
      throw Error("unknown method '" + step + "'", "--method", "known: " + known);
    if (source && !steps_.empty()) throw Error(step + " can only come first in '" + chain + "'", "--method", known);
    if (!steps_.empty() && steps_.back() == "seqslam")
      throw Error("nothing can follow seqslam in '" + chain + "'", "--method", known);
    if (!source && steps_.empty()) steps_.push_back("nearest");
    steps_.push_back(step);
  }
  if (steps_.empty()) throw Error("is empty", "--method", "known: " + known);
}

Method::Result Method::run(const Eigen::MatrixXf& reference, const Eigen::MatrixXf& query, const GroundTruth& truth,
                           const MatchingOptions& options) const {
  Scores scores = stoppable(steps_.front() == "mlp" ? classified(reference, query, options)
                                                    : similarity(reference, query, options.measure));
  Eigen::VectorXf confidence = Eigen::VectorXf::Constant(query.cols(), std::numeric_limits<float>::quiet_NaN());
  for (const std::string& step : steps_) {
    const bool contrast = step == "contrast", seqslam_last = step == "seqslam";
    if (contrast || seqslam_last) scores = scores.cached();
    const double least = contrast || seqslam_last ? least_contrast(scores, options.window) : 0;
    if (step == "csls") scores = csls(std::move(scores), options.neighbours);
    if (contrast)
      scores = transformed(std::move(scores), {.references = options.window / 2},
                           [=, &options](const Eigen::MatrixXf& block, Index, Index) -> Eigen::MatrixXf {
                             return -enhanced(block, options.window, least).cast<float>();
                           });
    if (step == "sequence" || step == "past")
      scores = sequence_similarity(std::move(scores), {.length = step == "past" ? options.past + 1 : options.sequence,
                                                       .causal = step == "past",
                                                       .slowest = options.slowest,
                                                       .fastest = options.fastest});
    // As published: contrast and velocity search, and an answer's confidence is how far its cost is below any rival's.
    const int half = options.sequence / 2;
    if (seqslam_last)
      scores =
          transformed(std::move(scores), {.before = half, .after = half},
                      [=, &options, &confidence](const Eigen::MatrixXf& block, Index, Index first) -> Eigen::MatrixXf {
                        const SeqSlam found = seqslam(enhanced(block, options.window, least), {.length = 2 * half});
                        for (Index q = 0; q < block.cols(); ++q)
                          if (found.matches[q] >= 0) confidence[first + q] = static_cast<float>(-found.ratios[q]);
                        return -found.costs.cast<float>();
                      });
  }
  Result result;
  const Index most = std::max(reference.cols(), query.cols());
  const Index pixel = options.overview > 0 ? (most + options.overview - 1) / options.overview : 0;
  if (pixel > 0) {
    result.overview.setConstant((reference.cols() + pixel - 1) / pixel, (query.cols() + pixel - 1) / pixel,
                                -std::numeric_limits<float>::infinity());
    scores = Scores(reference.cols(), query.cols(),
                    [&, scores = std::move(scores)](Index r, Index q, Eigen::Ref<Eigen::MatrixXf> block) {
                      scores.read(r, q, block);
                      add_to_overview(result.overview, pixel, q, block);
                    });
  }
  result.answers = answers(scores, truth);
  for (Index q = 0; q < query.cols(); ++q)
    if (!std::isnan(confidence[q])) result.answers.confidence[q] = confidence[q];
  return result;
}

}  // namespace citylearn::lab
