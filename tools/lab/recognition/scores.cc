// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/recognition/scores.h"

#include <algorithm>
#include <memory>
#include <utility>

namespace citylearn {
namespace {

using Eigen::Index;

constexpr Index kKernelFrames = 48;
constexpr Index kBlockQueries = 2 * kKernelFrames;

}  // namespace

Scores::Scores(Eigen::MatrixXf matrix) : references_(matrix.rows()), queries_(matrix.cols()) {
  read_ = [held = std::make_shared<const Eigen::MatrixXf>(std::move(matrix))](Index reference, Index query,
                                                                              Eigen::Ref<Eigen::MatrixXf> block) {
    block = held->block(reference, query, block.rows(), block.cols());
  };
}

Eigen::MatrixXf Scores::matrix() const {
  Eigen::MatrixXf all(references_, queries_);
  for_each_block([&](Index query, const Eigen::MatrixXf& block) { all.middleCols(query, block.cols()) = block; });
  return all;
}

Scores Scores::cached() const { return references_ * queries_ > Index{1} << 25 ? *this : Scores(matrix()); }

void Scores::for_each_block(Index first, Index count, const Take& take) const {
  Eigen::MatrixXf block;
  for (Index query = 0; query < queries_; query += kBlockQueries) {
    block.resize(count, std::min(kBlockQueries, queries_ - query));
    read(first, query, block);
    take(query, block);
  }
}

Scores transformed(Scores scores, const Margin& margin, Step step) {
  const Index references = scores.references(), queries = scores.queries();
  return {references, queries,
          [=, scores = std::move(scores), step = std::move(step)](Index reference, Index query,
                                                                  Eigen::Ref<Eigen::MatrixXf> block) {
            const Index top = std::min(reference, margin.references), left = std::min(query, margin.before);
            const Index rows = std::min(references - reference, block.rows() + margin.references) + top;
            const Index columns = std::min(queries - query, block.cols() + margin.after) + left;
            Eigen::MatrixXf around(rows, columns);
            scores.read(reference - top, query - left, around);
            block = step(around, reference - top, query - left).block(top, left, block.rows(), block.cols());
          }};
}

FrameRange whole_kernels(FrameRange range, Index total) {
  Index first = range.first / kKernelFrames * kKernelFrames;
  // One row or column would be multiplied as a vector.
  if (first > 0 && total - first < kKernelFrames) first -= kKernelFrames;
  const Index end = (range.first + range.count + kKernelFrames - 1) / kKernelFrames * kKernelFrames;
  return {first, std::min(total, end) - first};
}

}  // namespace citylearn
