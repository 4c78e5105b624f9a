// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "policy_service/network/checkpoint.h"

namespace citylearn {

/// Keeps the best checkpoint of a training in a file of its own, best.clk, beside the newest ones: that of the highest
/// mean SPL over the last 100 training episodes; in a curriculum, of the latest lesson. Used by one thread.
class BestCheckpoint {
 public:
  struct Figures {
    int lesson = 0;
    double spl = 0;
    std::uint64_t update = 0;
  };

  /// Knows the best of an earlier stretch of the run, whose file is in `folder`. One that cannot be read is replaced by
  /// the next.
  explicit BestCheckpoint(const std::string& folder);

  /// Writes the checkpoint if it is the best up to now. Throws Error naming the file, which then remains as it was.
  void consider(const Checkpoint& checkpoint);

  /// Returns what is known of the best; none before 100 episodes have ended.
  const std::optional<Figures>& figures() const { return figures_; }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::optional<Figures> figures_;
};

}  // namespace citylearn
