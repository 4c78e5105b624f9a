// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

namespace citylearn {

/// Notices when an agent becomes much worse than it was: its mean SPL falls below half of its best, which was 0.5 or
/// more. It is over at 0.8 of the best. Used by one thread.
class CollapseWatch {
 public:
  /// Begins with the best mean SPL of an earlier process.
  explicit CollapseWatch(double best = 0) : best_(best) {}

  /// Takes the mean SPL after an update. Returns whether the agent has collapsed.
  bool collapsed(double spl) {
    best_ = std::max(best_, spl);
    if (collapsed_)
      collapsed_ = spl < kRecovered * best_;
    else
      collapsed_ = best_ >= kGoodSpl && spl < kCollapsed * best_;
    return collapsed_;
  }
  double best() const { return best_; }

 private:
  static constexpr double kGoodSpl = 0.5, kCollapsed = 0.5, kRecovered = 0.8;  // SPL; shares of the best
  double best_;
  bool collapsed_ = false;
};

}  // namespace citylearn
