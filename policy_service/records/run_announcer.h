// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/wire/node.h"

namespace citylearn {

/// Announces a run to services that watch it: sends RunInfo at its start, once a second and at its end, and its
/// TrainingStats, again to those that missed some. Used by one thread.
class RunAnnouncer {
 public:
  struct Run {
    std::string agent, learner;  ///< names; no learner where nothing is learned
    std::uint64_t seed = 0, run_id = 0;
    std::uint64_t updates = 0;  ///< so far
    std::string manifest;       ///< JSON; left out where it does not fit a RunInfo
  };
  RunAnnouncer(Node& node, const Run& run);

  /// Publishes a figure and keeps it as long as this process lives.
  void add(msg::TrainingStat& stat);
  /// Answers requests and sends what is due. Call it whenever Node::wait() returns.
  void handle();
  void end();

 private:
  void send_info();

  Node& node_;
  msg::RunInfo info_;
  Clock::time_point next_info_{};
  std::uint64_t first_ = 0;       ///< update of the first one kept
  std::size_t size_ = 0;          ///< bytes of each
  std::vector<std::byte> stats_;  ///< encoded, end to end: a tenth of the messages' size
  msg::TrainingStat stat_;
  msg::TrainingStatRequest request_;
};

}  // namespace citylearn
