// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/layers/product.h"

#include <gtest/gtest.h>
#include <pthread.h>
#include <signal.h>

#include <atomic>
#include <memory>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "core/util/error.h"
#include "policy_service/network/layers/packed_weights.h"

namespace citylearn {
namespace {

using Floats = Eigen::MatrixXf;

/// Uses one library for a test.
class With {
 public:
  explicit With(Math math) : before_(used_math()) { set_math(name_of(math)); }
  ~With() { set_math(name_of(before_)); }

 private:
  Math before_;
};

float error(const Floats& a, const Floats& b) { return (a - b).norm() / b.norm(); }

TEST(Product, IsTheSameByAllLibraries) {
  for (const int inner : {3, 64, 257})
    for (const int cols : {1, 2, 33, 200}) {
      const int rows = 130;
      const Floats a = Floats::Random(rows, inner), b = Floats::Random(inner, cols);
      const Floats at = a.transpose(), bt = b.transpose(), before = Floats::Random(rows, cols);
      const Floats right = (a.cast<double>() * b.cast<double>()).cast<float>();
      for (const Math math : {Math::kEigen, Math::kOneDnn}) {
        SCOPED_TRACE(std::string(name_of(math)) + ", " + std::to_string(inner) + ", " + std::to_string(cols));
        const With with(math);
        Floats out;
        set_product(out, a, b);
        EXPECT_LT(error(out, right), 1e-6F);
        set_product(out, at.transpose(), b);
        EXPECT_LT(error(out, right), 1e-6F);
        set_product(out, a, bt.transpose());
        EXPECT_LT(error(out, right), 1e-6F);
        set_product(out, at.transpose(), bt.transpose());
        EXPECT_LT(error(out, right), 1e-6F);
        out = before;
        add_product(out, a, b);
        EXPECT_LT(error(out, right + before), 1e-6F);
      }
    }
}

TEST(Product, TakesPartsOfMatricesAndLeavesTheRest) {
  const Floats a = Floats::Random(100, 80), b = Floats::Random(90, 70);
  for (const Math math : {Math::kEigen, Math::kOneDnn}) {
    const With with(math);
    Floats out = Floats::Constant(120, 75, 7);
    set_product(out.block(10, 5, 90, 60), a.block(5, 8, 90, 70), b.block(9, 4, 70, 60));
    EXPECT_LT(error(out.block(10, 5, 90, 60), a.block(5, 8, 90, 70) * b.block(9, 4, 70, 60)), 1e-6F);
    out.block(10, 5, 90, 60).setConstant(7);
    EXPECT_EQ(out, Floats::Constant(120, 75, 7));
  }
}

TEST(Product, RepeatsItsBitsOnAnyThread) {
  const Floats a = Floats::Random(300, 200), b = Floats::Random(200, 100);
  const With with(Math::kOneDnn);
  Floats first, second;
  set_product(first, a, b);
  std::thread([&] { set_product(second, a, b); }).join();
  EXPECT_EQ(first, second);
}

std::atomic<int> signals_taken{0};

TEST(Product, ASignalLeavesItsMemoryAlone) {
  struct sigaction action {
  }, before{};
  action.sa_handler = [](int) { ++signals_taken; };
  action.sa_flags = SA_ONSTACK | SA_RESTART;
  ASSERT_EQ(sigaction(SIGALRM, &action, &before), 0);
  const With with(Math::kOneDnn);
  const Floats a = Floats::Random(1024, 320), b = Floats::Random(320, 64);
  Floats right, out;
  set_product(right, a, b);
  // To this thread alone, as those of other programs would be to the one that multiplies.
  std::atomic<bool> over{false};
  const pthread_t here = pthread_self();
  std::thread sender([&] {
    while (!over) {
      pthread_kill(here, SIGALRM);
      std::this_thread::yield();
    }
  });
  for (int i = 0; i < 20'000 && signals_taken < 2'000; ++i) {
    set_product(out, a, b);
    ASSERT_EQ(out, right);
    std::make_unique<Floats>(b);  // looks at the heap
  }
  over = true;
  sender.join();
  EXPECT_GE(signals_taken, 100);
  sigaction(SIGALRM, &before, nullptr);
}

TEST(Product, RoundsLargeFactorsToBfloat16Alone) {
  std::optional<With> with;
  try {
    with.emplace(Math::kOneDnnBfloat16);
  } catch (const Error& error) {
    EXPECT_EQ(used_math(), Math::kOneDnn);
    GTEST_SKIP() << error.what();
  }
  const Floats a = Floats::Random(130, 257), b = Floats::Random(257, 200), before = Floats::Random(130, 200);
  const Floats at = a.transpose(), bt = b.transpose(), right = a * b;
  Floats out = Floats::Zero(150, 200);
  const auto error_is = [&](const char* what, const Floats& wanted) {
    SCOPED_TRACE(what);
    EXPECT_LT(error(out.topRows(130), wanted), 4e-3F);
    EXPECT_GT(error(out.topRows(130), wanted), 1e-4F);
    EXPECT_TRUE(out.bottomRows(20).isZero());
  };
  set_product(out.topRows(130), a, b);
  error_is("as they are", right);
  set_product(out.topRows(130), at.transpose(), b);
  error_is("first transposed", right);
  set_product(out.topRows(130), a, bt.transpose());
  error_is("second transposed", right);
  out.topRows(130) = before;
  add_product(out.topRows(130), at.transpose(), bt.transpose());
  error_is("both transposed, added", right + before);

  {
    std::vector<std::uint16_t> twos(static_cast<std::size_t>(a.size()), 0x4000);
    const products::RoundedNumbers known(a.data(), twos);
    set_product(out.topRows(130), a, b);
    EXPECT_LT(error(out.topRows(130), Floats::Constant(130, 257, 2) * b), 4e-3F);
    set_product(out.topRows(130), Floats(a), b);
    error_is("a copy, which is not known", right);
  }
  set_product(out.topRows(130), a, b);
  error_is("known no longer", right);

  const Floats narrow = b.leftCols(8);
  set_product(out, a, narrow);
  EXPECT_LT(error(out, a * narrow), 1e-6F);
}

/// Returns the libraries that can multiply on this processor.
std::vector<Math> usable_math() {
  std::vector<Math> usable{Math::kEigen, Math::kOneDnn};
  try {
    const With with(Math::kOneDnnBfloat16);
    usable.push_back(Math::kOneDnnBfloat16);
  } catch (const Error&) {
  }
  return usable;
}

TEST(PackedWeights, MultiplyAsUnpackedOnesDo) {
  for (const Math math : usable_math())
    for (const auto& [rows, inner] :
         {std::pair{256, 64}, std::pair{1024, 256}, std::pair{130, 257}, std::pair{3, 256}}) {
      SCOPED_TRACE(std::string(name_of(math)) + ", " + std::to_string(rows) + " x " + std::to_string(inner));
      const With with(math);
      const float tolerance = math == Math::kOneDnnBfloat16 ? 4e-3F : 1e-6F;
      const Floats a = Floats::Random(rows, inner), back = Floats::Random(inner, rows), all = Floats::Random(inner, 40);
      PackedWeights<float> weights, transposed;
      for (const int cols : {4, 1, 2, 33, 4}) {  // other numbers of columns, other layouts
        const auto b = all.middleCols(3, cols);
        Floats out(rows, cols), before = Floats::Random(rows + 2, cols);
        weights.set_product(out, a, b);
        EXPECT_LT(error(out, a * b), tolerance);
        transposed.set_product(out, back.transpose(), b);
        EXPECT_LT(error(out, back.transpose() * b), tolerance);
        Floats sum = before;
        weights.add_product(sum.middleRows(1, rows), a, b);
        EXPECT_LT(error(sum.middleRows(1, rows), before.middleRows(1, rows) + a * b), tolerance);
        EXPECT_EQ(sum.row(0), before.row(0));
        EXPECT_EQ(sum.row(rows + 1), before.row(rows + 1));
      }
    }
}

TEST(PackedWeights, TakeOtherValuesWhenTold) {
  for (const Math math : usable_math()) {
    SCOPED_TRACE(name_of(math));
    const With with(math);
    Floats a = Floats::Random(256, 64), out(256, 8), again(256, 8);
    const Floats b = Floats::Random(64, 8);
    PackedWeights<float> weights, transposed;
    weights.set_product(out, a, b);
    transposed.set_product(again, Floats(a.transpose()).transpose(), b);
    a *= 2;
    weights.changed();
    transposed.changed();
    weights.set_product(out, a, b);
    EXPECT_LT(error(out, a * b), 4e-3F);
    const Floats back = a.transpose();
    transposed.set_product(again, back.transpose(), b);
    EXPECT_LT(error(again, a * b), 4e-3F);
  }
}

TEST(PackedWeights, GoFromThreadToThread) {
  for (const Math math : usable_math()) {
    SCOPED_TRACE(name_of(math));
    const With with(math);
    const Floats a = Floats::Random(1024, 256), b = Floats::Random(256, 16);
    Floats first(1024, 16), second(1024, 16);
    PackedWeights<float> weights;  // of a workspace, which goes from thread to thread
    weights.set_product(first, a, b);
    std::thread([&] { weights.set_product(second, a, b); }).join();
    EXPECT_EQ(first, second);
  }
}

TEST(Product, UnknownLibrariesAreRefused) {
  EXPECT_THROW(set_math("mkl"), Error);
  EXPECT_EQ(used_math(), Math::kOneDnn);
}

}  // namespace
}  // namespace citylearn
