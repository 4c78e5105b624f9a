// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/netvlad_head.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/util/error.h"
#include "core/util/random.h"

namespace citylearn {
namespace {

constexpr float kTiny = 1e-12f;  // a vector shorter than this is left as it is

/// The ratio of the weights of the nearest and the second centre, on average.
constexpr double kSharpness = 100;

struct Nearest {
  std::vector<Eigen::Index> cluster;  // of each feature
  Eigen::VectorXf distance, second;   // squared, to the nearest and to the next centre
};

/// Finds the nearest centre of each feature. Features (C x n) have length 1; centres are C x K.
Nearest assign(const Eigen::Ref<const Eigen::MatrixXf>& features, const Eigen::MatrixXf& centres) {
  constexpr Eigen::Index kBlock = 4096;  // columns a product, so that memory stays small
  Nearest nearest{std::vector<Eigen::Index>(features.cols()), Eigen::VectorXf(features.cols()),
                  Eigen::VectorXf(features.cols())};
  const Eigen::VectorXf lengths = centres.colwise().squaredNorm();
  for (Eigen::Index first = 0; first < features.cols(); first += kBlock) {
    const Eigen::Index count = std::min(kBlock, features.cols() - first);
    const Eigen::MatrixXf products = centres.transpose() * features.middleCols(first, count);
    for (Eigen::Index i = 0; i < count; ++i) {
      Eigen::VectorXf distances = lengths - 2 * products.col(i);
      const float own = features.col(first + i).squaredNorm();
      nearest.distance[first + i] = distances.minCoeff(&nearest.cluster[first + i]) + own;
      distances[nearest.cluster[first + i]] = std::numeric_limits<float>::infinity();
      nearest.second[first + i] = distances.minCoeff() + own;
    }
  }
  return nearest;
}

/// Chooses centres by k-means++ (Arthur & Vassilvitskii, 2007).
Eigen::MatrixXf first_centres(const Eigen::Ref<const Eigen::MatrixXf>& features, int clusters, Random& random) {
  Eigen::MatrixXf centres(features.rows(), clusters);
  Eigen::VectorXf distance = Eigen::VectorXf::Constant(features.cols(), std::numeric_limits<float>::infinity());
  for (int k = 0; k < clusters; ++k) {
    Eigen::Index chosen = static_cast<Eigen::Index>(random.below(features.cols()));
    if (k > 0) {
      double left = random.uniform() * distance.cast<double>().sum();
      for (chosen = 0; chosen + 1 < features.cols(); ++chosen) {
        left -= static_cast<double>(distance[chosen]);
        if (left < 0) break;
      }
    }
    centres.col(k) = features.col(chosen);
    distance = distance.cwiseMin((features.colwise() - centres.col(k)).colwise().squaredNorm().transpose());
  }
  return centres;
}

/// Finds centres by Lloyd's k-means.
Eigen::MatrixXf find_centres(const Eigen::Ref<const Eigen::MatrixXf>& features, int clusters) {
  constexpr int kRounds = 30;
  Random random({0x4E65'7456'4C41'44});  // "NetVLAD"
  Eigen::MatrixXf centres = first_centres(features, clusters, random);
  for (int round = 0; round < kRounds; ++round) {
    Nearest nearest = assign(features, centres);
    Eigen::MatrixXf sums = Eigen::MatrixXf::Zero(centres.rows(), clusters);
    Eigen::VectorXf counts = Eigen::VectorXf::Zero(clusters);
    for (Eigen::Index i = 0; i < features.cols(); ++i) {
      sums.col(nearest.cluster[i]) += features.col(i);
      counts[nearest.cluster[i]] += 1;
    }
    for (int k = 0; k < clusters; ++k) {
      if (counts[k] > 0) {
        sums.col(k) /= counts[k];
        continue;
      }
      // A centre without features moves to the feature that is farthest from its own centre.
      Eigen::Index farthest = 0;
      nearest.distance.maxCoeff(&farthest);
      nearest.distance[farthest] = -1;
      sums.col(k) = features.col(farthest);
    }
    const float moved = (sums - centres).squaredNorm();
    centres = sums;
    if (moved < 1e-10f) break;
  }
  return centres;
}

}  // namespace

int NetvladHead::dimension() const {
  return static_cast<int>(projection.size() > 0 ? projection.rows() : centroids.size());
}

Eigen::VectorXf NetvladHead::operator()(const Eigen::Ref<const Eigen::MatrixXf>& features) const {
  Eigen::MatrixXf unit = features;
  unit.array().colwise() /= features.rowwise().norm().array().max(kTiny);

  Eigen::MatrixXf assignment = unit * weight;  // n x K
  assignment.rowwise() += bias.transpose();
  assignment.colwise() -= assignment.rowwise().maxCoeff().eval();
  assignment = assignment.array().exp().matrix();
  assignment.array().colwise() /= assignment.rowwise().sum().array().eval();

  // The sum over features of a_k (x - c_k), as two products.
  Eigen::MatrixXf residuals = unit.transpose() * assignment;  // C x K
  residuals -= centroids * assignment.colwise().sum().asDiagonal();
  residuals.array().rowwise() /= residuals.colwise().norm().array().max(kTiny).eval();
  Eigen::VectorXf descriptor = residuals.reshaped();
  descriptor /= std::max(descriptor.norm(), kTiny);
  if (projection.size() == 0) return descriptor;

  Eigen::VectorXf projected = projection * descriptor + offset;
  projected /= std::max(projected.norm(), kTiny);
  return projected;
}

NetvladHead NetvladHead::learn(const Eigen::Ref<const Eigen::MatrixXf>& features, int clusters) {
  const std::string where = "netvlad";
  if (features.cols() < clusters)
    throw Error(
        "only " + std::to_string(features.cols()) + " local features for " + std::to_string(clusters) + " clusters",
        where, "give a larger training sample (--netvlad-lessons) or fewer clusters");
  NetvladHead head;
  head.centroids = find_centres(features, clusters);
  double alpha = 0;  // with a single cluster everything is assigned to it, whatever alpha
  if (clusters > 1) {
    const Nearest nearest = assign(features, head.centroids);
    const double gap = (nearest.second - nearest.distance).cast<double>().mean();
    if (!(gap > 1e-7))
      throw Error("the local features are too similar for this many clusters", where, "fewer clusters");
    alpha = std::log(kSharpness) / gap;
  }
  head.weight = static_cast<float>(2 * alpha) * head.centroids;
  head.bias = static_cast<float>(-alpha) * head.centroids.colwise().squaredNorm().transpose();
  return head;
}

}  // namespace citylearn
