// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/recognition/similarity.h"

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

#include "core/util/error.h"

namespace citylearn {
namespace {

using Eigen::Index;

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

/// Fills in a block of the products of all columns of `a` and `b`, a tile that stays in the cache after the other.
/// `finish` gets a tile with its first row and column.
template <class Finish>
void read_product(const Eigen::MatrixXf& a, const Eigen::MatrixXf& b, Index row, Index column,
                  Eigen::Ref<Eigen::MatrixXf> block, const Finish& finish) {
  constexpr Index kTileRows = 480;
  const FrameRange rows = whole_kernels({row, block.rows()}, a.cols());
  const FrameRange columns = whole_kernels({column, block.cols()}, b.cols());
  const Index end = rows.first + rows.count;
  Eigen::MatrixXf tile;
  for (Index from = rows.first, count; from < end; from += count) {
    count = end - from < 2 * kTileRows ? end - from : kTileRows;
    tile.resize(count, columns.count);
    tile.noalias() = a.middleCols(from, count).transpose() * b.middleCols(columns.first, columns.count);
    finish(from, columns.first, tile);
    const Index begin = std::max(from, row), size = std::min(from + count, row + block.rows()) - begin;
    block.middleRows(begin - row, size) = tile.block(begin - from, column - columns.first, size, block.cols());
  }
}

}  // namespace

Measure measure_of(const std::string& name) {
  if (name == "cosine") return Measure::kCosine;
  if (name == "l1") return Measure::kL1;
  throw Error("unknown measure '" + name + "'", "", "known: cosine, l1");
}

Scores similarity(const Eigen::MatrixXf& reference, const Eigen::MatrixXf& query, Measure measure) {
  if (reference.rows() != query.rows())
    throw Error("reference features have " + std::to_string(reference.rows()) + " dimensions, query features " +
                std::to_string(query.rows()));
  if (measure == Measure::kL1)
    return Scores(reference.cols(), query.cols(), [&](Index r, Index q, Eigen::Ref<Eigen::MatrixXf> block) {
      // No product of matrices: blocks that stay in the cache keep the memory from being what counts.
      constexpr Index kBlock = 16;
      for (Index from = 0; from < block.rows(); from += kBlock)
        for (Index j = 0; j < block.cols(); ++j)
          for (Index i = from; i < std::min(from + kBlock, block.rows()); ++i)
            block(i, j) = -(reference.col(r + i) - query.col(q + j)).lpNorm<1>();
    });
  return Scores(reference.cols(), query.cols(),
                [&, of_reference = inverse_norms(reference), of_query = inverse_norms(query)](
                    Index r, Index q, Eigen::Ref<Eigen::MatrixXf> block) {
                  read_product(reference, query, r, q, block, [&](Index row, Index column, Eigen::MatrixXf& tile) {
                    tile.array().colwise() *= of_reference.segment(row, tile.rows()).array();
                    tile.array().rowwise() *= of_query.segment(column, tile.cols()).transpose().array();
                  });
                });
}

Scores csls(Scores scores, int neighbours) {
  if (neighbours < 1) throw Error("CSLS needs at least one neighbour");
  const Index references = scores.references(), queries = scores.queries();
  if (references == 0 || queries == 0) return scores;
  scores = scores.cached();
  Eigen::VectorXf of_query(queries), of_reference(references);
  scores.for_each_block([&](Index query, const Eigen::MatrixXf& block) {
    of_query.segment(query, block.cols()) = mean_of_largest(block, std::min<Index>(neighbours, references));
  });
  // A reference frame's similarities to all queries, for as many frames at once as 128 MB hold.
  const Index most = std::max<Index>(1, (Index{1} << 25) / queries);
  Eigen::MatrixXf turned;
  for (Index first = 0, count; first < references; first += count) {
    count = std::min(most, references - first);
    turned.resize(queries, count);
    scores.for_each_block(first, count, [&](Index query, const Eigen::MatrixXf& block) {
      turned.middleRows(query, block.cols()) = block.transpose();
    });
    of_reference.segment(first, count) = mean_of_largest(turned, std::min<Index>(neighbours, queries));
  }
  return transformed(std::move(scores), {}, [=](const Eigen::MatrixXf& block, Index reference, Index query) {
    Eigen::MatrixXf local = 2 * block;
    local.colwise() -= of_reference.segment(reference, block.rows());
    local.rowwise() -= of_query.segment(query, block.cols()).transpose();
    return local;
  });
}

}  // namespace citylearn
