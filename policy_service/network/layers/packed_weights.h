// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <list>
#include <map>
#include <type_traits>

#include "product.h"

namespace citylearn {

/// Lays out a matrix once for oneDNN's narrow products, in the precision of used_math(). Used by one thread at a time.
class PackedFactor {
 public:
  PackedFactor();
  ~PackedFactor();
  /// Makes the next product lay out its first factor anew.
  void changed();
  /// out = a * b, or out += a * b. Since changed(), `a` has been the same; `b` is not transposed.
  void multiply(const products::Factor& a, const products::Factor& b, bool adds, float* out, std::ptrdiff_t stride);

 private:
  struct Shape;
  struct Pack;
  struct Product;
  Product& product_of(const Shape& shape);

  std::list<Pack> packs_;              // products refer to them
  std::map<Shape, Product> products_;  // actors meet any number of columns, as observations come
};

/// Products of the same weights with many narrow matrices, as an LSTM's steps are. With 4 columns such a product takes
/// half the time of set_product(), and a quarter in bfloat16. For one thread at a time.
template <class S>
class PackedWeights {
 public:
  /// Returns whether they pay where single steps of so many columns share them, as an actor's do. Each actor has its
  /// own, and many of them do not fit the processor's caches: they must at least be small.
  static bool pay_for_steps(std::ptrdiff_t columns) {
    return kByOneDnn && columns >= 8 && used_math() == Math::kOneDnnBfloat16;
  }
  /// Notes that the weights have changed.
  void changed() {
    if constexpr (kByOneDnn) packed_.changed();
    stale_ = true;
  }
  /// Says whether the next products share the weights. Those that do not are citylearn's set_product() and
  /// add_product().
  void share(bool shared) { shared_ = shared; }
  /// out = weights * b. The weights are a matrix, or the transpose of one; `b` and `out` are as for set_product().
  template <class Out, class A, class B>
  void set_product(Out&& out, const A& weights, const B& b) {
    if (!shared_)
      citylearn::set_product(out, weights, b);
    else if (!multiply(out, weights, b, false))
      out.noalias() = plain(weights) * b;
  }
  /// out += weights * b, likewise.
  template <class Out, class A, class B>
  void add_product(Out&& out, const A& weights, const B& b) {
    if (!shared_)
      citylearn::add_product(out, weights, b);
    else if (!multiply(out, weights, b, true))
      out.noalias() += plain(weights) * b;
  }

 private:
  static constexpr bool kByOneDnn = std::is_same_v<S, float>;
  using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

  template <class Out, class A, class B>
  bool multiply(Out& out, const A& weights, const B& b, bool adds) {
    if constexpr (kByOneDnn) {
      if (!products::by_onednn(weights.rows(), weights.cols(), b.cols())) return false;
      packed_.multiply(products::factor(weights), products::factor(b), adds, out.data(), out.outerStride());
      return true;
    }
    return false;
  }
  template <class D>
  const D& plain(const Eigen::MatrixBase<D>& weights) {
    return weights.derived();
  }
  /// A narrow product with a transposed matrix runs at half the speed of one with the matrix itself.
  template <class D>
  const Matrix& plain(const Eigen::Transpose<D>& weights) {
    if (stale_) transposed_ = weights;
    stale_ = false;
    return transposed_;
  }

  std::conditional_t<kByOneDnn, PackedFactor, char> packed_;
  Matrix transposed_;
  bool stale_ = true;  // `transposed_`
  bool shared_ = true;
};

}  // namespace citylearn
