// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bench/bench.h"
#include "bench/figures.h"
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
