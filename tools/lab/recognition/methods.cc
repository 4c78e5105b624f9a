// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/recognition/methods.h"

#include <cmath>
#include <limits>
#include <sstream>

#include "core/util/error.h"
#include "core/wire/service.h"
#include "tools/lab/descriptors.h"
#include "tools/lab/recognition/classifier.h"
#include "tools/lab/recognition/sequence.h"

namespace citylearn::lab {
namespace {

Eigen::MatrixXf classified(const Eigen::MatrixXf& reference, const Eigen::MatrixXf& query,
                           const MatchingOptions& options) {
  const FrameClassifier classifier(
      reference, {.hidden = options.hidden, .epochs = options.epochs, .seed = options.seed, .stop = [] {
                    return stop_requested();
                  }});
  if (stop_requested()) throw Stopped{};
  return classifier.probabilities(query);
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
  Result result;
  Eigen::MatrixXf& scores = result.similarity;
  for (const std::string& step : steps_) {
    if (stop_requested()) throw Stopped{};
    if (step == "nearest") scores = similarity(reference, query, options.measure);
    if (step == "mlp") scores = classified(reference, query, options);
    if (step == "csls") scores = csls(scores, options.neighbours);
    if (step == "contrast") scores = -local_contrast(-scores.cast<double>(), options.window).cast<float>();
    if (step == "sequence" || step == "past")
      scores = sequence_similarity(scores, {.length = step == "past" ? options.past + 1 : options.sequence,
                                            .causal = step == "past",
                                            .slowest = options.slowest,
                                            .fastest = options.fastest});
  }
  if (steps_.back() != "seqslam") {
    result.answers = answers(scores, truth);
    return result;
  }
  // As published: contrast and velocity search, and an answer's confidence is how far its cost is below any rival's.
  const SeqSlam found =
      seqslam(local_contrast(-scores.cast<double>(), options.window), {.length = options.sequence / 2 * 2});
  scores = -found.costs.cast<float>();
  result.answers = answers(scores, truth);
  for (int q = 0; q < result.answers.queries(); ++q)
    if (!std::isnan(found.ratios[q])) result.answers.confidence[q] = static_cast<float>(-found.ratios[q]);
  return result;
}

}  // namespace citylearn::lab
