// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>

#include "core/util/types.h"

namespace citylearn {

/// The NetVLAD layer (Arandjelovic et al., CVPR 2016, section 3.1) over a map of C-dimensional local features, with K
/// clusters, and what may follow it: a linear projection (their PCA whitening).
struct NetvladHead {
  Eigen::MatrixXf centroids;   ///< C x K, the c_k
  Eigen::MatrixXf weight;      ///< C x K, the w_k of the soft assignment
  Eigen::VectorXf bias;        ///< K, the b_k
  Eigen::MatrixXf projection;  ///< D x (K C), its columns in the order of the file; empty: none
  Eigen::VectorXf offset;      ///< D, added after the projection

  int channels() const { return static_cast<int>(centroids.rows()); }
  int clusters() const { return static_cast<int>(centroids.cols()); }
  /// D, or K C without a projection.
  int dimension() const;

  /// Returns the descriptor of n local features, one a row (n x C, each scaled to length 1 first): residuals summed by
  /// soft assignment (eq. 4), scaled to length 1 within each cluster, cluster after cluster, and as a whole;
  /// then projected and scaled to length 1 again. A zero vector stays zero.
  Eigen::VectorXf operator()(const Eigen::Ref<const Eigen::MatrixXf>& features) const;

  /// Finds centres by k-means over local features of a reference traversal (C x n, each of length 1), and the
  /// assignment by w = 2 alpha c, b = -alpha |c|^2 (eq. 3) with alpha such that the largest assignment is 100 times the
  /// second on average (their appendix A). The same features give the same head. Throws Error when there are fewer
  /// features than clusters or the features are too similar.
  static NetvladHead learn(const Eigen::Ref<const Eigen::MatrixXf>& features, int clusters);

  /// A safetensors file: F32 tensors centroids [K,C], conv.weight [K,C] or [K,C,1,1], and if wanted conv.bias [K],
  /// wpca.weight [D,K C] (or [D,K C,1,1]), wpca.bias [D]. parse() throws Error naming `where` and the tensor when the
  /// file holds anything else, sides do not fit or numbers are not finite; sizes are checked before memory is taken.
  Bytes save() const;
  static NetvladHead parse(std::span<const std::byte> bytes, const std::string& where);
};

}  // namespace citylearn
