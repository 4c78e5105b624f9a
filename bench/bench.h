// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <exception>
#include <functional>
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

/// Runs `body` as the main() of a benchmark after `app`, which has its name, has read the command line; `setup` comes
/// first. An exception becomes one line on standard error and status 1.
template <class Body>
int run(
    CLI::App& app, int argc, char** argv, const Body& body, const std::function<void()>& setup = [] {}) {
  try {
    setup();
    app.parse(argc, argv);
    body();
    return 0;
  } catch (const CLI::ParseError& error) {
    return app.exit(error);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", app.get_name().c_str(), error.what());
    return 1;
  }
}

}  // namespace citylearn::bench
