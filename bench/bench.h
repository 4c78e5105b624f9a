// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdio>
#include <exception>
#include <vector>

#include "core/util/types.h"

// What benchmarks share.

namespace citylearn::bench {

/// Seconds that `work` takes.
template <class Work>
double seconds(const Work& work) {
  const Clock::time_point begin = Clock::now();
  work();
  return seconds_since(begin);
}

inline double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// Runs `body` as the main() of benchmark `name`. An exception becomes one line on standard error and status 1.
template <class Body>
int run(const char* name, const Body& body) {
  try {
    body();
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", name, error.what());
    return 1;
  }
}

}  // namespace citylearn::bench
