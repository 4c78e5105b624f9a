// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/packed_weights.h"

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

}  // namespace

/// What a product depends on beside numbers.
struct PackedFactor::Shape {
  std::ptrdiff_t rows, inner, cols;  // of a * b
  std::ptrdiff_t a_stride, b_stride, out_stride;
  bool transposed, rounded, adds;
  bool operator==(const Shape&) const = default;
};

/// The product of one shape: out' = b' a', since oneDNN takes matrices row after row.
struct PackedFactor::Product {
  explicit Product(const Shape& its_shape) : shape(its_shape) {
    using dnnl::memory;
    constexpr auto kFloat = memory::data_type::f32;
    const auto type = shape.rounded ? memory::data_type::bf16 : kFloat;
    const memory::desc in({shape.cols, shape.inner}, type, memory::dims{shape.b_stride, 1});
    const memory::desc any({shape.inner, shape.rows}, type, memory::format_tag::any);
    const memory::desc out({shape.cols, shape.rows}, kFloat, memory::dims{shape.out_stride, 1});
    dnnl::primitive_attr attributes;
    dnnl::post_ops after;
    if (shape.adds) after.append_sum(1);
    attributes.set_post_ops(after);
    const dnnl::matmul::primitive_desc chosen(dnnl::matmul::desc(in, any, out), attributes, processor());
    product = dnnl::matmul(chosen);
    narrow = memory(in, processor(), DNNL_MEMORY_NONE);
    packed = memory(chosen.weights_desc(), processor());
    result = memory(out, processor(), DNNL_MEMORY_NONE);
    plain = memory({{shape.inner, shape.rows},
                    kFloat,
                    shape.transposed ? memory::dims{1, shape.a_stride} : memory::dims{shape.a_stride, 1}},
                   processor(), DNNL_MEMORY_NONE);
    pack = dnnl::reorder(plain, packed);
    arguments = {{DNNL_ARG_SRC, narrow}, {DNNL_ARG_WEIGHTS, packed}, {DNNL_ARG_DST, result}};
  }

  const Shape shape;
  dnnl::matmul product;
  dnnl::reorder pack;
  dnnl::memory plain, packed, narrow, result;
  std::unordered_map<int, dnnl::memory> arguments;
  std::vector<std::uint16_t> rounded;  // the second factor
};

PackedFactor::PackedFactor() = default;
PackedFactor::~PackedFactor() = default;

void PackedFactor::multiply(const products::Factor& a, const products::Factor& b, bool adds, float* out,
                            std::ptrdiff_t stride) {
  products::prepare_thread();
  thread_local dnnl::stream stream(processor());
  const bool rounded = used_math() == Math::kOneDnnBfloat16;
  const Shape shape{.rows = a.height(),
                    .inner = a.width(),
                    .cols = b.cols,
                    .a_stride = a.stride,
                    .b_stride = rounded ? b.rows : b.stride,
                    .out_stride = stride,
                    .transposed = a.transposed,
                    .rounded = rounded,
                    .adds = adds};
  if (!product_ || product_->shape != shape) {
    product_ = std::make_unique<Product>(shape);  // oneDNN keeps the code of shapes that it has met
    stale_ = true;
  }
  Product& product = *product_;
  if (stale_) {
    product.plain.set_data_handle(const_cast<float*>(a.data), stream);  // it is only read
    product.pack.execute(stream, product.plain, product.packed);
    stale_ = false;
  }
  if (rounded) products::round_to_bfloat16(b, product.rounded);
  product.narrow.set_data_handle(rounded ? static_cast<void*>(product.rounded.data()) : const_cast<float*>(b.data),
                                 stream);
  product.result.set_data_handle(out, stream);
  product.product.execute(stream, product.arguments);
  stream.wait();
}

}  // namespace citylearn
