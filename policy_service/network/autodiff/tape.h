// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "core/util/error.h"
#include "policy_service/network/network_inputs.h"

namespace citylearn {

template <class S>
class Tape;

/// One step of a computation: a matrix, and how its gradient flows to the matrices that it was computed from.
template <class S>
struct TapeNode {
  Matrix<S> value, gradient;
  bool requires_gradient = false;
  /// Passes `gradient`, the derivative by `value`, on; empty for constants and parameters.
  std::function<void(const Matrix<S>& value, const Matrix<S>& gradient)> backward;
};

/// A matrix on a tape. Copies denote the same matrix; all are invalid once the tape is cleared.
template <class S>
class Variable {
 public:
  Variable() = default;
  Variable(Tape<S>& tape, TapeNode<S>& node) : tape_(&tape), node_(&node) {}

  /// Returns whether it denotes a matrix.
  explicit operator bool() const { return node_ != nullptr; }
  Tape<S>& tape() const { return *tape_; }
  const Matrix<S>& value() const { return node_->value; }
  std::ptrdiff_t rows() const { return value().rows(); }
  std::ptrdiff_t cols() const { return value().cols(); }
  bool requires_gradient() const { return node_->requires_gradient; }
  /// Returns the derivative by this matrix, of its size, during and after Tape::backward().
  Matrix<S>& gradient() const { return node_->gradient; }
  /// Returns its size for messages: "3 x 12".
  std::string size() const { return std::to_string(rows()) + " x " + std::to_string(cols()); }

 private:
  Tape<S>* tape_ = nullptr;
  TapeNode<S>* node_ = nullptr;
};

/// Records operations (operations.h) in the order in which they are computed, and differentiates them in reverse: each
/// matrix passes its gradient on once all that was computed from it has passed on its own (Linnainmaa, 1976). Keeps its
/// memory when it is cleared. Used by one thread at a time.
template <class S>
class Tape {
 public:
  Tape() = default;
  Tape(const Tape&) = delete;
  Tape& operator=(const Tape&) = delete;

  /// Forgets all matrices.
  void clear() { used_ = 0; }

  /// Adds a matrix without a gradient.
  template <class Expression>
  Variable<S> constant(const Expression& value) {
    return leaf(value, false);
  }
  /// Adds a matrix by which to differentiate.
  template <class Expression>
  Variable<S> parameter(const Expression& value) {
    return leaf(value, true);
  }
  /// Adds a matrix that `forward(Matrix<S>& value)` fills from `inputs`. `backward(value, gradient)` adds to the
  /// gradient of each input that requires one; it is not called when none does.
  template <class Inputs, class Forward, class Backward>
  Variable<S> record(const Inputs& inputs, Forward forward, Backward backward) {
    TapeNode<S>& node = next();
    node.requires_gradient = false;
    for (const Variable<S>& input : inputs) node.requires_gradient |= input.requires_gradient();
    forward(node.value);
    if (node.requires_gradient) node.backward = std::move(backward);
    return {*this, node};
  }

  /// Computes the gradients of a number whose derivatives by some matrices are given. May be called again.
  void backward(const std::vector<std::pair<Variable<S>, const Matrix<S>*>>& derivatives) {
    for (std::size_t i = 0; i < used_; ++i)
      if (nodes_[i].requires_gradient) nodes_[i].gradient.setZero(nodes_[i].value.rows(), nodes_[i].value.cols());
    for (const auto& [variable, derivative] : derivatives) {
      if (derivative->rows() != variable.rows() || derivative->cols() != variable.cols())
        throw Error("a derivative is not " + variable.size() + ", as the matrix is", "tape");
      if (variable.requires_gradient()) variable.gradient() += *derivative;
    }
    for (std::size_t i = used_; i-- > 0;)
      if (nodes_[i].requires_gradient && nodes_[i].backward) nodes_[i].backward(nodes_[i].value, nodes_[i].gradient);
  }

 private:
  template <class Expression>
  Variable<S> leaf(const Expression& value, bool requires_gradient) {
    TapeNode<S>& node = next();
    node.value = value;
    node.requires_gradient = requires_gradient;
    return {*this, node};
  }

  TapeNode<S>& next() {
    if (used_ == nodes_.size()) nodes_.emplace_back();
    nodes_[used_].backward = nullptr;
    return nodes_[used_++];
  }

  std::deque<TapeNode<S>> nodes_;  // whose elements stay where they are
  std::size_t used_ = 0;
};

}  // namespace citylearn
