// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/wire/node.h"

namespace citylearn {

/// A run as those who watch see it: RunInfo at its start, once a second and at its end, and its TrainingStats, again
/// for whom they did not reach. Used by one thread.
class RunRecord {
 public:
  struct What {
    std::string agent, learner;  ///< names; no learner where nothing is learned
    std::uint64_t seed = 0, job = 0;
    std::uint64_t updates = 0;  ///< so far
    std::string manifest;       ///< JSON; left out where it is larger than a RunInfo can be
  };
  /// Begins.
  RunRecord(Node& node, const What& what);

  /// Publishes one, and keeps it as long as this process lives.
  void add(msg::TrainingStat& stat);
  /// Answers what was asked for and sends what is due. Call it whenever Node::wait() returns.
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

/// Time in microseconds since 1970: names a run for good when it begins.
std::uint64_t new_job();

/// The job of the run whose manifest.json this is; a new one where there is none, or it names none.
std::uint64_t job_of(const std::string& manifest_path);

}  // namespace citylearn
