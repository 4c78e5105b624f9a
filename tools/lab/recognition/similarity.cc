// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/recognition/similarity.h"

#include <algorithm>
#include <functional>
#include <vector>

#include "core/util/error.h"

namespace citylearn {
namespace {

Eigen::VectorXf inverse_norms(const Eigen::Ref<const Eigen::MatrixXf>& features) {
  const Eigen::VectorXf norms = features.colwise().norm();
  return norms.unaryExpr([](float norm) { return norm > 0 ? 1 / norm : 0.0f; });
}

/// Returns the mean of each column's `count` largest entries.
Eigen::VectorXf mean_of_largest(const Eigen::Ref<const Eigen::MatrixXf>& matrix, Eigen::Index count) {
  Eigen::VectorXf means(matrix.cols());
  std::vector<float> column(matrix.rows());
  for (Eigen::Index c = 0; c < matrix.cols(); ++c) {
    Eigen::VectorXf::Map(column.data(), matrix.rows()) = matrix.col(c);
    std::nth_element(column.begin(), column.begin() + (count - 1), column.end(), std::greater<>());
    means[c] = Eigen::VectorXf::Map(column.data(), count).mean();
  }
  return means;
}

}  // namespace

Measure measure_of(const std::string& name) {
  if (name == "cosine") return Measure::kCosine;
  if (name == "l2") return Measure::kL2;
  if (name == "l1") return Measure::kL1;
  throw Error("unknown measure '" + name + "'", "", "known: cosine, l2, l1");
}

Eigen::MatrixXf similarity(const Eigen::Ref<const Eigen::MatrixXf>& reference,
                           const Eigen::Ref<const Eigen::MatrixXf>& query, Measure measure) {
  if (reference.rows() != query.rows())
    throw Error("reference features have " + std::to_string(reference.rows()) + " dimensions, query features " +
                std::to_string(query.rows()));
  Eigen::MatrixXf result(reference.cols(), query.cols());
  if (measure == Measure::kCosine) {
    result.noalias() = reference.transpose() * query;
    result.array().colwise() *= inverse_norms(reference).array();
    result.array().rowwise() *= inverse_norms(query).transpose().array();
    return result;
  }
  if (measure == Measure::kL1) {
    // No product of matrices: blocks that stay in the cache keep the memory from being what counts.
    constexpr Eigen::Index kBlock = 16;
    for (Eigen::Index from = 0; from < reference.cols(); from += kBlock)
      for (Eigen::Index q = 0; q < query.cols(); ++q)
        for (Eigen::Index r = from; r < std::min(from + kBlock, reference.cols()); ++r)
          result(r, q) = -(reference.col(r) - query.col(q)).lpNorm<1>();
    return result;
  }
  // |a - b|^2 = |a|^2 + |b|^2 - 2ab cancels; about a common centre the terms are no larger than the distances.
  const Eigen::VectorXf centre = reference.rowwise().mean();
  const Eigen::MatrixXf a = reference.colwise() - centre, b = query.colwise() - centre;
  result.noalias() = -2 * (a.transpose() * b);
  result.colwise() += a.colwise().squaredNorm().transpose();
  result.rowwise() += b.colwise().squaredNorm();
  result = -result.cwiseMax(0).cwiseSqrt();
  return result;
}

Eigen::MatrixXf csls(const Eigen::Ref<const Eigen::MatrixXf>& similarity, int neighbours) {
  if (neighbours < 1) throw Error("CSLS needs at least one neighbour");
  if (similarity.size() == 0) return similarity;
  const Eigen::VectorXf of_query = mean_of_largest(similarity, std::min<Eigen::Index>(neighbours, similarity.rows()));
  const Eigen::MatrixXf turned = similarity.transpose();
  const Eigen::VectorXf of_reference = mean_of_largest(turned, std::min<Eigen::Index>(neighbours, similarity.cols()));
  Eigen::MatrixXf result = 2 * similarity;
  result.colwise() -= of_reference;
  result.rowwise() -= of_query.transpose();
  return result;
}

}  // namespace citylearn
