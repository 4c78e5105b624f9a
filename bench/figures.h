// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

// The figures by which `./run bench --keep` and `--compare` judge a benchmark (bench/run.py).

namespace citylearn::bench {

enum class Better { kLower, kHigher };

struct Figure {
  std::string name;  ///< unique in its benchmark and the same in each run of it: "cyclonedds, node"
  double value = 0;
  std::string unit;  ///< "steps/s", "us", "ratio"
  Better better = Better::kHigher;
};

/// Appends the figure, a line of JSON, to the file that the environment variable CITYLEARN_BENCH_FIGURES names. Does
/// nothing without the variable. Throws Error when the file cannot be written.
void record_figure(const Figure& figure);

}  // namespace citylearn::bench
