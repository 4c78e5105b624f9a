// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/exchange/log_sender.h"
#include "core/wire/node.h"
#include "core/wire/rejections.h"

namespace citylearn {

/// Announces a run to services that watch it: sends RunInfo at its start, once a second and at its end, and its
/// TrainingStats, again to those that missed some, as a LogSender decides. Used by one thread.
class RunAnnouncer {
 public:
  struct Run {
    std::string agent, learner;  ///< names; no learner where nothing is learned
    std::uint64_t seed = 0, run_id = 0;
    std::uint64_t updates = 0;  ///< so far
    std::string manifest;       ///< JSON; left out where it does not fit a RunInfo
  };
  RunAnnouncer(Node& node, const Run& run);

  /// Numbers and publishes the figures of an update and keeps them as long as this process lives.
  void add(msg::TrainingStat& stat);
  /// Takes acknowledgements and sends what is due. Call it whenever Node::wait() returns.
  void handle();
  void end();
  /// Returns whether a service that watches the run lacks figures and is alive as far as is known.
  bool reader_expected() const { return log_.reader_expected(Clock::now()); }

 private:
  void on_acknowledgement();
  void send_info();

  Node& node_;
  Rejections rejections_{node_};
  msg::RunInfo info_;
  Clock::time_point next_info_{};
  LogSender log_;
  std::size_t size_ = 0;          ///< bytes of each figure
  std::vector<std::byte> stats_;  ///< encoded, end to end: a tenth of the messages' size
  msg::TrainingStat stat_;
  msg::TrainingAcknowledgement acknowledgement_;
};

}  // namespace citylearn
