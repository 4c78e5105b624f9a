// SPDX-License-Identifier: Apache-2.0
#include "layers.h"

#include <Eigen/QR>

namespace citylearn {

template <class S>
void orthogonal(Random& random, double gain, Eigen::Map<Matrix<S>> weights) {
  const bool tall = weights.rows() >= weights.cols();
  Matrix<double> normal(tall ? weights.rows() : weights.cols(), tall ? weights.cols() : weights.rows());
  for (double& value : normal.reshaped()) value = random.normal();
  Eigen::HouseholderQR<Matrix<double>> decomposition(normal);
  Matrix<double> q = decomposition.householderQ() * Matrix<double>::Identity(normal.rows(), normal.cols());
  for (std::ptrdiff_t j = 0; j < q.cols(); ++j)  // without this the distribution would not be uniform (Mezzadri, 2007)
    if (decomposition.matrixQR()(j, j) < 0) q.col(j) = -q.col(j);
  if (tall)
    weights = (gain * q).template cast<S>();
  else
    weights = (gain * q.transpose()).template cast<S>();
}

template void orthogonal(Random&, double, Eigen::Map<Matrix<NetworkScalar>>);

}  // namespace citylearn
