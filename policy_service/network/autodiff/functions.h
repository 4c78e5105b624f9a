// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "policy_service/network/autodiff/tape.h"

// Nonlinear functions of matrices of a tape.

namespace citylearn {

/// Applies `function(array)` to all elements; `slope(array)` returns their derivatives, given the function's values.
template <class S, class Function, class Slope>
Variable<S> map_elements(const Variable<S>& a, Function function, Slope slope) {
  return a.tape().record(
      std::array{a}, [&](Matrix<S>& value) { value = function(a.value().array()); },
      [a, slope](const Matrix<S>& value, const Matrix<S>& gradient) {
        a.gradient().array() += gradient.array() * slope(value.array());
      });
}

template <class S>
Variable<S> tanh(const Variable<S>& a) {
  return map_elements(
      a, [](const auto& x) { return x.tanh(); }, [](const auto& y) { return S(1) - y.square(); });
}

/// Returns the logistic function.
template <class S>
Variable<S> sigmoid(const Variable<S>& a) {
  return map_elements(
      a, [](const auto& x) { return x.logistic(); }, [](const auto& y) { return y * (S(1) - y); });
}

template <class S>
Variable<S> relu(const Variable<S>& a) {
  return map_elements(
      a, [](const auto& x) { return x.max(S(0)); }, [](const auto& y) { return (y > S(0)).template cast<S>(); });
}

/// Returns the softmax of each column.
template <class S>
Variable<S> softmax(const Variable<S>& a) {
  return a.tape().record(
      std::array{a},
      [&](Matrix<S>& value) {
        value = a.value();
        for (auto column : value.colwise()) {
          column = (column.array() - column.maxCoeff()).exp().matrix().eval();
          column /= column.sum();
        }
      },
      [a](const Matrix<S>& value, const Matrix<S>& gradient) {
        for (std::ptrdiff_t i = 0; i < value.cols(); ++i)
          a.gradient().col(i).array() +=
              value.col(i).array() * (gradient.col(i).array() - value.col(i).dot(gradient.col(i)));
      });
}

}  // namespace citylearn
