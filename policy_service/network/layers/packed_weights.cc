// SPDX-License-Identifier: Apache-2.0
#include "packed_weights.h"

#include <algorithm>
#include <cstdint>
#include <oneapi/dnnl/dnnl.hpp>
#include <unordered_map>
#include <vector>

namespace citylearn {
namespace {

/// One of the process: a network's workspace goes from thread to thread, and its products with it.
const dnnl::engine& processor() {
  static const dnnl::engine engine(dnnl::engine::kind::cpu, 0);
  return engine;
}

/// Returns the matrix that is meant in bfloat16, column after column without gaps. oneDNN's own way to transpose and
/// round takes three times as long.
std::uint16_t* rounded_as_meant(const products::Factor& a) {
  thread_local std::vector<std::uint16_t> as_it_lies, as_meant;
  std::uint16_t* const lies = products::rounded(a, as_it_lies);
  if (!a.transposed) return lies;
  constexpr std::ptrdiff_t kRows = 128, kCols = 32;  // of a tile that stays in the cache
  using Numbers = Eigen::Matrix<std::uint16_t, Eigen::Dynamic, Eigen::Dynamic>;
  using Tile = Eigen::Matrix<std::uint16_t, Eigen::Dynamic, Eigen::Dynamic, 0, kRows, kCols>;
  as_meant.resize(static_cast<std::size_t>(a.rows * a.cols));
  const Eigen::Map<const Numbers> from(lies, a.rows, a.cols);
  Eigen::Map<Numbers> to(as_meant.data(), a.cols, a.rows);
  for (std::ptrdiff_t col = 0; col < a.cols; col += kCols)
    for (std::ptrdiff_t row = 0; row < a.rows; row += kRows) {
      const std::ptrdiff_t rows = std::min(kRows, a.rows - row), cols = std::min(kCols, a.cols - col);
      const Tile tile = from.block(row, col, rows, cols);
      to.block(col, row, cols, rows) = tile.transpose();
    }
  return as_meant.data();
}

}  // namespace

/// The properties of a product other than its numbers.
struct PackedFactor::Shape {
  std::ptrdiff_t rows, inner, cols;  // of a * b
  std::ptrdiff_t a_stride, b_stride, out_stride;
  bool transposed, rounded, adds;
  auto operator<=>(const Shape&) const = default;
};

/// A layout that some products want, and the weights in it.
struct PackedFactor::Pack {
  dnnl::memory packed;
  bool stale = true;
};

/// The product of one shape: out' = b' a', since oneDNN takes matrices row after row.
struct PackedFactor::Product {
  dnnl::matmul product;
  dnnl::reorder pack;
  dnnl::memory plain, narrow, result;
  Pack* weights;
  std::unordered_map<int, dnnl::memory> arguments;
};

PackedFactor::PackedFactor() = default;
PackedFactor::~PackedFactor() = default;

void PackedFactor::changed() {
  for (Pack& each : packs_) each.stale = true;
}

PackedFactor::Product& PackedFactor::product_of(const Shape& shape) {
  const auto [known, is_new] = products_.try_emplace(shape);
  Product& product = known->second;
  if (!is_new) return product;
  using dnnl::memory;
  constexpr auto kFloat = memory::data_type::f32;
  const auto type = shape.rounded ? memory::data_type::bf16 : kFloat;
  const memory::desc in({shape.cols, shape.inner}, type, memory::dims{shape.b_stride, 1});
  const memory::desc any({shape.inner, shape.rows}, type, memory::format_tag::any);
  const memory::desc out({shape.cols, shape.rows}, kFloat, memory::dims{shape.out_stride, 1});
  const memory::desc plain({shape.inner, shape.rows}, type,
                           shape.transposed ? memory::dims{1, shape.a_stride} : memory::dims{shape.a_stride, 1});
  dnnl::primitive_attr attributes;
  dnnl::post_ops after;
  if (shape.adds) after.append_sum(1);
  attributes.set_post_ops(after);
#if DNNL_VERSION_MAJOR == 2
  const dnnl::matmul::primitive_desc chosen(dnnl::matmul::desc(in, any, out), attributes, processor());
#else
  const dnnl::matmul::primitive_desc chosen(processor(), in, any, out, attributes);
#endif
  product.product = dnnl::matmul(chosen);
  product.narrow = memory(in, processor(), DNNL_MEMORY_NONE);
  product.result = memory(out, processor(), DNNL_MEMORY_NONE);
  product.plain = memory(plain, processor(), DNNL_MEMORY_NONE);
  auto same = std::ranges::find(packs_, chosen.weights_desc(), [](const Pack& each) { return each.packed.get_desc(); });
  if (same == packs_.end()) same = packs_.insert(same, Pack{memory(chosen.weights_desc(), processor())});
  product.weights = &*same;
  product.pack = dnnl::reorder(product.plain, same->packed);
  product.arguments = {
      {DNNL_ARG_SRC, product.narrow}, {DNNL_ARG_WEIGHTS, same->packed}, {DNNL_ARG_DST, product.result}};
  return product;
}

void PackedFactor::multiply(const products::Factor& a, const products::Factor& b, bool adds, float* out,
                            std::ptrdiff_t stride) {
  products::prepare_thread();
  thread_local dnnl::stream stream(processor());
  thread_local std::vector<std::uint16_t> rounded_b;
  const bool rounded = used_math() == Math::kOneDnnBfloat16;
  Product& product = product_of({.rows = a.height(),
                                 .inner = a.width(),
                                 .cols = b.cols,
                                 .a_stride = rounded ? a.height() : a.stride,
                                 .b_stride = rounded ? b.rows : b.stride,
                                 .out_stride = stride,
                                 .transposed = a.transposed && !rounded,
                                 .rounded = rounded,
                                 .adds = adds});
  if (product.weights->stale) {
    product.plain.set_data_handle(rounded ? static_cast<void*>(rounded_as_meant(a)) : const_cast<float*>(a.data));
    product.pack.execute(stream, product.plain, product.weights->packed);
    product.weights->stale = false;
  }
  product.narrow.set_data_handle(rounded ? static_cast<void*>(products::rounded(b, rounded_b))
                                         : const_cast<float*>(b.data));  // it is only read
  product.result.set_data_handle(out);
  product.product.execute(stream, product.arguments);
  stream.wait();
}

}  // namespace citylearn
