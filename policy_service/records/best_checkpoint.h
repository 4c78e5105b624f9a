// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "policy_service/network/checkpoint/checkpoint.h"

namespace citylearn {

/// Keeps the best checkpoint of a training in a file of its own, best.clk, beside the newest ones. Agents that were
/// evaluated (--evaluate-every) count more than others, and the one with the highest mean SPL there is the best.
/// Without evaluations it is that of the highest mean SPL over the last 100 training episodes; in a curriculum, of the
/// latest lesson. Used by one thread.
class BestCheckpoint {
 public:
  struct Figures {
    std::uint64_t update = 0;
    int lesson = 0;
    std::optional<double> training_spl;    ///< none before 100 episodes of the lesson have ended
    std::optional<double> evaluation_spl;  ///< of this agent, where it was evaluated

    /// Returns the SPL that it was chosen by.
    double spl() const { return evaluation_spl ? *evaluation_spl : training_spl.value_or(0); }
    /// Returns "update 350, SPL 0.970 in training".
    std::string description() const;
  };

  /// Knows the best of an earlier stretch of the run, whose file is in `folder`. One that cannot be read is replaced by
  /// the next.
  explicit BestCheckpoint(const std::string& folder);

  /// Returns a checkpoint that says the mean SPL of its agent in an evaluation.
  static Checkpoint evaluated(Checkpoint checkpoint, double spl);
  /// Writes the checkpoint if it is the best up to now. Throws Error naming the file, which then remains as it was.
  void consider(const Checkpoint& checkpoint);

  /// Returns what is known of the best; none before an evaluation, or before 100 episodes have ended.
  const std::optional<Figures>& figures() const { return figures_; }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::optional<Figures> figures_;
};

}  // namespace citylearn
