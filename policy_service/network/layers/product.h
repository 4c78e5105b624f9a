// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace citylearn {

/// The library that computes the networks' products of matrices in single precision; kMathNames has the same order. The
/// last one rounds the factors of large products to bfloat16 (8 bits instead of 24) and adds up in single precision.
enum class Math { kEigen, kOneDnn, kOneDnnBfloat16 };
inline constexpr std::array<std::string_view, 3> kMathNames{"eigen", "onednn", "onednn_bfloat16"};

inline std::string_view name_of(Math math) { return kMathNames[static_cast<std::size_t>(math)]; }
/// Sets it for the whole process, before networks are at work. The same seed gives other last bits with another one.
/// Throws Error if there is none of this name, or if it needs another processor.
void set_math(std::string_view name);
/// Returns what was set; at first kOneDnn.
Math used_math();
/// Returns the release of oneDNN in use, "3.7.2". Another one may give other last bits.
std::string onednn_release();
/// Computes a first product. oneDNN takes 50 ms and more for it, in which it writes code for this processor; what a
/// service does meanwhile costs nothing if another thread calls this.
void prepare_math();

namespace products {

/// A matrix as it lies in memory, column after column, `stride` numbers from one to the next.
struct Factor {
  const float* data;
  std::ptrdiff_t rows, cols, stride;  // as it lies there
  bool transposed;                    // whether its transpose is meant

  std::ptrdiff_t height() const { return transposed ? cols : rows; }  // of what is meant
  std::ptrdiff_t width() const { return transposed ? rows : cols; }
};

template <class D>
Factor factor(const Eigen::MatrixBase<D>& m) {
  return {m.derived().data(), m.rows(), m.cols(), m.derived().outerStride(), false};
}
template <class D>
Factor factor(const Eigen::Transpose<D>& m) {
  Factor result = factor(m.nestedExpression());
  result.transposed = true;
  return result;
}

/// Returns whether oneDNN is in use and better at a product that takes so many multiplications.
bool by_onednn(std::ptrdiff_t rows, std::ptrdiff_t inner, std::ptrdiff_t cols);
/// Readies the calling thread for oneDNN; products do so themselves.
void prepare_thread();
/// Rounds so many numbers to the nearest ones of 8 bits.
void round_to_bfloat16(const float* from, std::ptrdiff_t count, std::uint16_t* to);
/// Returns a matrix in bfloat16 as it lies there, column after column without gaps: in `memory`, or in what
/// RoundedNumbers have of it.
std::uint16_t* rounded(const Factor& from, std::vector<std::uint16_t>& memory);

/// While it exists, products of this thread find these numbers, which stay as they are, in `rounded` in bfloat16.
class RoundedNumbers {
 public:
  RoundedNumbers(const float* numbers, std::span<std::uint16_t> rounded);
  ~RoundedNumbers();
  RoundedNumbers(const RoundedNumbers&) = delete;
  RoundedNumbers& operator=(const RoundedNumbers&) = delete;
};

/// out = keep * out + a * b.
void multiply(const Factor& a, const Factor& b, float keep, float* out, std::ptrdiff_t stride);

template <class Out, class A, class B>
bool multiply(Out& out, const A& a, const B& b, float keep) {
  if constexpr (std::is_same_v<typename A::Scalar, float>) {
    if (by_onednn(a.rows(), a.cols(), b.cols())) {
      out.resize(a.rows(), b.cols());  // a part of a matrix has this size already
      multiply(factor(a), factor(b), keep, out.data(), out.outerStride());
      return true;
    }
  }
  return false;
}

}  // namespace products

/// out = a * b. The factors are matrices, blocks of whole columns or rows of them, or transposes of these; `out`, a
/// matrix or block of the right size, overlaps none of them.
template <class Out, class A, class B>
void set_product(Out&& out, const A& a, const B& b) {
  if (!products::multiply(out, a, b, 0)) out.noalias() = a * b;
}
/// out += a * b, likewise.
template <class Out, class A, class B>
void add_product(Out&& out, const A& a, const B& b) {
  if (!products::multiply(out, a, b, 1)) out.noalias() += a * b;
}

}  // namespace citylearn
