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

/// Returns the matrices one `below` the other, else side by side.
template <class S>
Variable<S> stacked(const std::vector<Variable<S>>& parts, bool below) {
  const Variable<S>& first = parts.at(0);
  std::ptrdiff_t height = below ? 0 : first.rows(), width = below ? first.cols() : 0;
  for (const Variable<S>& part : parts) {
    if (below ? part.cols() != first.cols() : part.rows() != first.rows())
      throw Error(first.size() + (below ? " above " : " beside ") + part.size(),
                  below ? "tape, stack_rows" : "tape, stack_columns");
    (below ? height : width) += below ? part.rows() : part.cols();
  }
  // Calls `each` with each part and its block of the whole.
  const auto for_each_block = [below](const std::vector<Variable<S>>& all, auto& whole, const auto& each) {
    std::ptrdiff_t at = 0;
    for (const Variable<S>& part : all) {
      each(part, whole.block(below ? at : 0, below ? 0 : at, part.rows(), part.cols()));
      at += below ? part.rows() : part.cols();
    }
  };
  return first.tape().record(
      parts,
      [&](Matrix<S>& value) {
        value.resize(height, width);
        for_each_block(parts, value, [](const Variable<S>& part, auto block) { block = part.value(); });
      },
      [parts, for_each_block](const Matrix<S>& /*value*/, const Matrix<S>& gradient) {
        for_each_block(parts, gradient, [](const Variable<S>& part, auto block) {
          if (part.requires_gradient()) part.gradient() += block;
        });
      });
}

/// Returns the matrices one below the other.
template <class S>
Variable<S> stack_rows(const std::vector<Variable<S>>& parts) {
  return stacked(parts, /*below=*/true);
}

/// Returns the matrices side by side.
template <class S>
Variable<S> stack_columns(const std::vector<Variable<S>>& parts) {
  return stacked(parts, /*below=*/false);
}

}  // namespace citylearn
