// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

#include "policy_service/network/autodiff/tape.h"

// Parts of matrices of a tape, and matrices joined. Each throws Error naming the sizes when they do not fit.

namespace citylearn {

/// Returns rows `begin`..`begin + count - 1`.
template <class S>
Variable<S> rows(const Variable<S>& a, std::ptrdiff_t begin, std::ptrdiff_t count) {
  if (begin < 0 || count < 0 || begin + count > a.rows())
    throw Error("rows " + std::to_string(begin) + ".." + std::to_string(begin + count - 1) + " of " + a.size(),
                "tape, rows");
  return a.tape().record(
      std::array{a}, [&](Matrix<S>& value) { value = a.value().middleRows(begin, count); },
      [=](const Matrix<S>& /*value*/, const Matrix<S>& gradient) {
        a.gradient().middleRows(begin, count) += gradient;
      });
}

/// Returns columns `begin`..`begin + count - 1`.
template <class S>
Variable<S> columns(const Variable<S>& a, std::ptrdiff_t begin, std::ptrdiff_t count) {
  if (begin < 0 || count < 0 || begin + count > a.cols())
    throw Error("columns " + std::to_string(begin) + ".." + std::to_string(begin + count - 1) + " of " + a.size(),
                "tape, columns");
  return a.tape().record(
      std::array{a}, [&](Matrix<S>& value) { value = a.value().middleCols(begin, count); },
      [=](const Matrix<S>& /*value*/, const Matrix<S>& gradient) {
        a.gradient().middleCols(begin, count) += gradient;
      });
}

/// Returns column which[i] of `a` as column i.
template <class S>
Variable<S> gather_columns(const Variable<S>& a, const std::vector<int>& which) {
  for (const int column : which)
    if (column < 0 || column >= a.cols())
      throw Error("column " + std::to_string(column) + " of " + a.size(), "tape, gather_columns");
  return a.tape().record(
      std::array{a}, [&](Matrix<S>& value) { value = a.value()(Eigen::all, which); },
      [a, which](const Matrix<S>& /*value*/, const Matrix<S>& gradient) {
        for (std::size_t i = 0; i < which.size(); ++i)
          a.gradient().col(which[i]) += gradient.col(static_cast<std::ptrdiff_t>(i));
      });
}

/// Returns the matrices one below the other.
template <class S>
Variable<S> stack_rows(const std::vector<Variable<S>>& parts) {
  std::ptrdiff_t height = 0;
  for (const Variable<S>& part : parts) {
    if (part.cols() != parts.front().cols())
      throw Error(parts.front().size() + " above " + part.size(), "tape, stack_rows");
    height += part.rows();
  }
  return parts.at(0).tape().record(
      parts,
      [&](Matrix<S>& value) {
        value.resize(height, parts.front().cols());
        std::ptrdiff_t begin = 0;
        for (const Variable<S>& part : parts) {
          value.middleRows(begin, part.rows()) = part.value();
          begin += part.rows();
        }
      },
      [parts](const Matrix<S>& /*value*/, const Matrix<S>& gradient) {
        std::ptrdiff_t begin = 0;
        for (const Variable<S>& part : parts) {
          if (part.requires_gradient()) part.gradient() += gradient.middleRows(begin, part.rows());
          begin += part.rows();
        }
      });
}

/// Returns the matrices side by side.
template <class S>
Variable<S> stack_columns(const std::vector<Variable<S>>& parts) {
  std::ptrdiff_t width = 0;
  for (const Variable<S>& part : parts) {
    if (part.rows() != parts.front().rows())
      throw Error(parts.front().size() + " beside " + part.size(), "tape, stack_columns");
    width += part.cols();
  }
  return parts.at(0).tape().record(
      parts,
      [&](Matrix<S>& value) {
        value.resize(parts.front().rows(), width);
        std::ptrdiff_t begin = 0;
        for (const Variable<S>& part : parts) {
          value.middleCols(begin, part.cols()) = part.value();
          begin += part.cols();
        }
      },
      [parts](const Matrix<S>& /*value*/, const Matrix<S>& gradient) {
        std::ptrdiff_t begin = 0;
        for (const Variable<S>& part : parts) {
          if (part.requires_gradient()) part.gradient() += gradient.middleCols(begin, part.cols());
          begin += part.cols();
        }
      });
}

}  // namespace citylearn
