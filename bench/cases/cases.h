// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <algorithm>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "tests/support/processes/service.h"

// What the cases of bench_cases share.

namespace citylearn::bench {

/// Each adds its options to the command of its name and returns what it measures. NAME.md states its question.
using Measure = std::function<void()>;
Measure beliefs(CLI::App& command);
Measure loop(CLI::App& command);
Measure roles(CLI::App& command);
Measure security(CLI::App& command);
Measure services(CLI::App& command);

inline double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

enum class Better { kLower, kHigher };

/// A figure by which `./run bench --against` judges a benchmark (bench/run.py).
struct Figure {
  std::string name;  ///< unique in its benchmark and the same in each run of it: "cyclonedds, node"
  double value = 0;
  std::string unit;  ///< "steps/s", "us", "ratio"
  Better better = Better::kHigher;
};

/// Appends the figure, a line of JSON, to the file that the environment variable CITYLEARN_BENCH_FIGURES names. Does
/// nothing without the variable. Throws Error when the file cannot be written.
void record_figure(const Figure& figure);

/// Services on loopback that find none but one another. They are killed when this goes.
class Session {
 public:
  explicit Session(std::string middleware);
  /// Starts a program with the session's options; it logs to NAME.log.
  testing::Service& start(testing::Arguments command, const std::string& name);
  const std::string& name() const { return name_; }
  const testing::Folder& folder() const { return folder_; }  ///< for what the programs write

 private:
  testing::Folder folder_;
  std::string middleware_, name_;
  std::vector<std::unique_ptr<testing::Service>> services_;
};

constexpr int kDomain = 150;  ///< of all sessions

}  // namespace citylearn::bench
