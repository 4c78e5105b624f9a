// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "core/task/action.h"
#include "policy_service/network/agent_network.h"

namespace citylearn {

inline constexpr double kMasked = -1e9;  ///< logit of an action that is not allowed
inline constexpr double kStretch = 3;  ///< scalars of networks are stored divided by this: they learn that much faster

/// Lays tensors one after another into the flat vector of parameters.
class TensorLayout {
 public:
  /// Returns the tensor's index.
  std::size_t add(std::string name, std::ptrdiff_t rows, std::ptrdiff_t cols) {
    tensors_.push_back({std::move(name), rows, cols, size_});
    size_ += rows * cols;
    return tensors_.size() - 1;
  }
  const std::vector<Tensor>& tensors() const { return tensors_; }
  std::ptrdiff_t size() const { return size_; }

  template <class S>
  Eigen::Map<const Matrix<S>> view(const Vector<S>& flat, std::size_t index) const {
    const Tensor& tensor = tensors_[index];
    return {flat.data() + tensor.offset, tensor.rows, tensor.cols};
  }
  template <class S>
  Eigen::Map<Matrix<S>> view(Vector<S>& flat, std::size_t index) const {
    const Tensor& tensor = tensors_[index];
    return {flat.data() + tensor.offset, tensor.rows, tensor.cols};
  }

 private:
  std::vector<Tensor> tensors_;
  std::ptrdiff_t size_ = 0;
};

/// Fills `weights` with a random matrix whose shorter side is orthonormal, times `gain` (Saxe, McClelland & Ganguli,
/// 2014).
template <class S>
void orthogonal(Random& random, double gain, Eigen::Map<Matrix<S>> weights);

/// Sets the logits of actions that are not allowed to kMasked.
template <class S>
void mask_logits(const std::vector<std::uint8_t>& allowed, Matrix<S>& logits) {
  for (std::ptrdiff_t column = 0; column < logits.cols(); ++column)
    for (int action = 0; action < kActions; ++action)
      if (!(allowed[static_cast<std::size_t>(column)] >> action & 1)) logits(action, column) = static_cast<S>(kMasked);
}

}  // namespace citylearn
