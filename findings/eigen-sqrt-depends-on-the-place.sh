#!/usr/bin/env bash
# Eigen 3.4.0 (Debian 12): sqrt() of an array of floats is not the processor's exact square root but an estimate and one
# step of Newton's, in builds without any option too (EIGEN_FAST_MATH is 1 by default). More than a third of all results
# are off by their last bit, and what is left over at an array's end is computed exactly: equal numbers have different
# roots in one array, by their place. Programs that compute in blocks get other bits. -DEIGEN_FAST_MATH=0 mends it.
# Seen with SSE2 alone, as any x86-64 processor has it. Needs g++. Status 1: this has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
apt-get download -qq libeigen3-dev=3.4.0-4 2>/dev/null
dpkg -x libeigen3-dev*.deb .
cat >roots.cc <<'END'
#include <Eigen/Core>
#include <cmath>
#include <cstdio>
int main() {
  const Eigen::ArrayXf numbers = Eigen::ArrayXf::LinSpaced(1000, 1.f, 1000.f), roots = numbers.sqrt();
  int wrong = 0;
  float one = 0;  // a number whose root is off
  for (int i = 0; i < 1000; ++i)
    if (roots(i) != std::sqrt(numbers(i))) one = ++wrong == 1 ? numbers(i) : one;
  const Eigen::ArrayXf equal = Eigen::ArrayXf::Constant(5, one), first_and_last = equal.sqrt();
  std::printf("%d of 1000 roots are not std::sqrt's", wrong);
  if (wrong > 0) std::printf("; of five numbers %g: first %.9g, last %.9g", one, first_and_last(0), first_and_last(4));
  std::printf("\n");
  return wrong > 333 && first_and_last(0) != first_and_last(4) ? 0 : 1;
}
END
for option in -DEIGEN_FAST_MATH=1 -DEIGEN_FAST_MATH=0; do
  g++ -std=c++20 -O2 $option -I usr/include/eigen3 roots.cc -o roots
  echo "$option: $(./roots || true)"
done
g++ -std=c++20 -O2 -I usr/include/eigen3 roots.cc -o default && ./default
