// SPDX-License-Identifier: Apache-2.0
#include "product.h"

#include <omp.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <functional>
#include <map>
#include <oneapi/dnnl/dnnl.hpp>
#include <tuple>
#include <vector>

#include "core/util/error.h"
#include "core/util/text.h"

namespace citylearn {
namespace {

// oneDNN takes matrices row after row, so what lies here is the transpose of each for it: out' = b' a'.

std::atomic<Math> chosen_math{Math::kOneDnn};
thread_local const float* known_numbers = nullptr;  // of RoundedNumbers
thread_local std::span<std::uint16_t> known_rounded;

/// Products of one thread in bfloat16.
class Bfloat16Products {
 public:
  using Factor = products::Factor;

  void multiply(const Factor& a, const Factor& b, float keep, float* out, std::ptrdiff_t stride) {
    std::uint16_t* const rounded_a = products::rounded(a, a_);
    std::uint16_t* const rounded_b = products::rounded(b, b_);
    const std::ptrdiff_t rows = a.height(), inner = a.width(), cols = b.width();
    using dnnl::memory;
    using Type = memory::data_type;
    const auto lies = [](std::ptrdiff_t height, std::ptrdiff_t width, bool transposed) {
      return memory::desc({width, height}, Type::bf16, transposed ? memory::dims{1, width} : memory::dims{height, 1});
    };
    const memory::desc left = lies(inner, cols, b.transposed), right = lies(rows, inner, a.transposed);
    const memory::desc result({cols, rows}, Type::f32, memory::dims{stride, 1});
    auto [known, is_new] = known_.try_emplace({rows, inner, cols, stride, a.transposed, b.transposed, keep != 0});
    if (is_new) {
      dnnl::primitive_attr attributes;
      dnnl::post_ops after;
      if (keep != 0) after.append_sum(keep);
      attributes.set_post_ops(after);
#if DNNL_VERSION_MAJOR == 2
      known->second = dnnl::matmul({dnnl::matmul::desc(left, right, result), attributes, engine_});
#else
      known->second = dnnl::matmul({engine_, left, right, result, attributes});
#endif
    }
    known->second.execute(stream_, {{DNNL_ARG_SRC, memory(left, engine_, rounded_b)},
                                    {DNNL_ARG_WEIGHTS, memory(right, engine_, rounded_a)},
                                    {DNNL_ARG_DST, memory(result, engine_, out)}});
    stream_.wait();
  }

 private:
  dnnl::engine engine_{dnnl::engine::kind::cpu, 0};
  dnnl::stream stream_{engine_};
  std::map<std::tuple<std::ptrdiff_t, std::ptrdiff_t, std::ptrdiff_t, std::ptrdiff_t, bool, bool, bool>, dnnl::matmul>
      known_;
  std::vector<std::uint16_t> a_, b_;
};

/// Gives signal handlers of this thread a stack of their own, if they ask for one (SA_ONSTACK). Some kernels of oneDNN
/// use the stack pointer for memory of the heap, which a signal would overwrite (its issue 4845, mended in 3.12).
class SignalStack {
 public:
  SignalStack() {
    stack_t present{};
    if (sigaltstack(nullptr, &present) != 0 || (present.ss_flags & SS_DISABLE) == 0) return;  // it has one
    memory_.resize(static_cast<std::size_t>(std::max(64L << 10, 4 * sysconf(_SC_MINSIGSTKSZ))));
    const stack_t ours{.ss_sp = memory_.data(), .ss_flags = 0, .ss_size = memory_.size()};
    sigaltstack(&ours, nullptr);
  }
  ~SignalStack() {
    const stack_t none{.ss_sp = nullptr, .ss_flags = SS_DISABLE, .ss_size = 0};
    if (!memory_.empty()) sigaltstack(&none, nullptr);
  }
  SignalStack(const SignalStack&) = delete;
  SignalStack& operator=(const SignalStack&) = delete;

 private:
  std::vector<std::byte> memory_;
};

}  // namespace

void set_math(std::string_view name) {
  const auto found = std::ranges::find(kMathNames, name);
  if (found == kMathNames.end())
    throw Error("'" + std::string(name) + "' is unknown", "--math", "choose one of " + joined(kMathNames));
  const Math math = static_cast<Math>(found - kMathNames.begin());
  constexpr int kBfloat16 = static_cast<int>(dnnl::cpu_isa::avx512_core_bf16);
  if (math == Math::kOneDnnBfloat16 && (static_cast<int>(dnnl::get_effective_cpu_isa()) & kBfloat16) != kBfloat16)
    throw Error("this processor has no products of bfloat16", "--math " + std::string(name), "choose onednn");
  chosen_math = math;
}

std::string onednn_release() {
  const dnnl_version_t* const release = dnnl_version();
  return std::to_string(release->major) + "." + std::to_string(release->minor) + "." + std::to_string(release->patch);
}

Math used_math() { return chosen_math; }

void prepare_math() {
  if (used_math() == Math::kEigen) return;
  const Eigen::MatrixXf zeros = Eigen::MatrixXf::Zero(32, 32);
  Eigen::MatrixXf out(32, 32);
  products::multiply(products::factor(zeros), products::factor(zeros), 0, out.data(), out.outerStride());
}

bool products::by_onednn(std::ptrdiff_t rows, std::ptrdiff_t inner, std::ptrdiff_t cols) {
  // Measured with AVX-512: Eigen is as fast or faster at narrow and at small products.
  return chosen_math.load(std::memory_order_relaxed) != Math::kEigen && rows >= 16 && cols >= 2 &&
         rows * inner * cols >= 1 << 15;
}

void products::prepare_thread() {
  // oneDNN starts threads by OpenMP, which counts for each of our threads. Ours divide the work already.
  thread_local const bool alone = (omp_set_num_threads(1), true);
  thread_local const SignalStack signal_stack;
  static_cast<void>(alone);
  static_cast<void>(signal_stack);
}

void products::round_to_bfloat16(const float* from, std::ptrdiff_t count, std::uint16_t* to) {
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    const auto bits = std::bit_cast<std::uint32_t>(from[i]);
    to[i] = static_cast<std::uint16_t>((bits + 0x7fff + (bits >> 16 & 1)) >> 16);
  }
}

products::RoundedNumbers::RoundedNumbers(const float* numbers, std::span<std::uint16_t> rounded) {
  known_numbers = numbers;
  known_rounded = rounded;
}
products::RoundedNumbers::~RoundedNumbers() { known_rounded = {}; }

std::uint16_t* products::rounded(const Factor& from, std::vector<std::uint16_t>& memory) {
  const std::less_equal<const float*> before;
  if (from.stride == from.rows && before(known_numbers, from.data) &&
      before(from.data + from.rows * from.cols, known_numbers + known_rounded.size()))
    return &known_rounded[static_cast<std::size_t>(from.data - known_numbers)];
  // It never shrinks: what grows anew is filled with zeros first.
  memory.resize(std::max(memory.size(), static_cast<std::size_t>(from.rows * from.cols)));
  for (std::ptrdiff_t col = 0; col < from.cols; ++col)
    round_to_bfloat16(from.data + col * from.stride, from.rows, memory.data() + col * from.rows);
  return memory.data();
}

void products::multiply(const Factor& a, const Factor& b, float keep, float* out, std::ptrdiff_t stride) {
  prepare_thread();
  const std::ptrdiff_t rows = a.height(), inner = a.width(), cols = b.width();
  constexpr std::ptrdiff_t kWide = 64;  // rounding the factors of a narrower product costs more than it saves
  if (used_math() == Math::kOneDnnBfloat16 && std::min({rows, inner, cols}) >= kWide) {
    thread_local Bfloat16Products rounded;
    rounded.multiply(a, b, keep, out, stride);
    return;
  }
  dnnl::sgemm(b.transposed ? 'T' : 'N', a.transposed ? 'T' : 'N', cols, rows, inner, 1, b.data, b.stride, a.data,
              a.stride, keep, out, stride);
}

}  // namespace citylearn
