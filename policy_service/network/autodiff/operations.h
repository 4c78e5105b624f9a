// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>

#include "policy_service/network/autodiff/tape.h"

// Operations on matrices of a tape. A column is a sample, as everywhere. Each throws Error naming the sizes when they
// do not fit.

namespace citylearn {

/// Throws Error when `fit` is false.
template <class S>
void require_fit(bool fit, const char* operation, const Variable<S>& a, const Variable<S>& b) {
  if (!fit)
    throw Error("matrices of " + a.size() + " and " + b.size() + " do not fit", std::string("tape, ") + operation);
}

/// Returns the matrix product.
template <class S>
Variable<S> operator*(const Variable<S>& a, const Variable<S>& b) {
  require_fit(a.cols() == b.rows(), "product", a, b);
  return a.tape().record(
      std::array{a, b}, [&](Matrix<S>& value) { value.noalias() = a.value() * b.value(); },
      [a, b](const Matrix<S>& /*value*/, const Matrix<S>& gradient) {
        if (a.requires_gradient()) a.gradient().noalias() += gradient * b.value().transpose();
        if (b.requires_gradient()) b.gradient().noalias() += a.value().transpose() * gradient;
      });
}

template <class S>
Variable<S> operator*(S factor, const Variable<S>& a) {
  return a.tape().record(
      std::array{a}, [&](Matrix<S>& value) { value = factor * a.value(); },
      [factor, a](const Matrix<S>& /*value*/, const Matrix<S>& gradient) { a.gradient() += factor * gradient; });
}

/// Returns the sum. A bias, `b` of one column, is added to each column of `a`.
template <class S>
Variable<S> operator+(const Variable<S>& a, const Variable<S>& b) {
  require_fit(a.rows() == b.rows() && (b.cols() == a.cols() || b.cols() == 1), "sum", a, b);
  const bool bias = b.cols() != a.cols();
  return a.tape().record(
      std::array{a, b},
      [&](Matrix<S>& value) {
        if (bias)
          value = a.value().colwise() + b.value().col(0);
        else
          value = a.value() + b.value();
      },
      [a, b, bias](const Matrix<S>& /*value*/, const Matrix<S>& gradient) {
        if (a.requires_gradient()) a.gradient() += gradient;
        if (!b.requires_gradient()) return;
        if (bias)
          b.gradient() += gradient.rowwise().sum();
        else
          b.gradient() += gradient;
      });
}

template <class S>
Variable<S> operator-(const Variable<S>& a, const Variable<S>& b) {
  return a + S(-1) * b;
}

/// Returns the product of each element with the one at the same place.
template <class S>
Variable<S> cwise_product(const Variable<S>& a, const Variable<S>& b) {
  require_fit(a.rows() == b.rows() && a.cols() == b.cols(), "element-wise product", a, b);
  return a.tape().record(
      std::array{a, b}, [&](Matrix<S>& value) { value = a.value().cwiseProduct(b.value()); },
      [a, b](const Matrix<S>& /*value*/, const Matrix<S>& gradient) {
        if (a.requires_gradient()) a.gradient() += gradient.cwiseProduct(b.value());
        if (b.requires_gradient()) b.gradient() += gradient.cwiseProduct(a.value());
      });
}

/// Multiplies column i by factors[i], which are constants: 0 wipes the state where an episode begins.
template <class S>
Variable<S> scale_columns(const Variable<S>& a, const Vector<S>& factors) {
  if (factors.size() != a.cols())
    throw Error(std::to_string(factors.size()) + " factors for a matrix of " + a.size(), "tape, scale_columns");
  return a.tape().record(
      std::array{a}, [&](Matrix<S>& value) { value = a.value() * factors.asDiagonal(); },
      [a, factors](const Matrix<S>& /*value*/, const Matrix<S>& gradient) {
        a.gradient() += gradient * factors.asDiagonal();
      });
}

}  // namespace citylearn
