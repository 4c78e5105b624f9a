// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/dds/middleware.h"

namespace citylearn {

/// Shows progress on standard error: a bar on a terminal, a plain line every few seconds elsewhere.
class ProgressBar {
 public:
  ProgressBar();
  /// Shows how far `what` is: `fraction` 0..1, `rate` in steps per second, `left` in seconds (negative = unknown), and
  /// `note`, the present figures.
  void show(const std::string& what, double fraction, double rate, double left, const std::string& note);
  /// Ends the line of the bar.
  void finish();
  ~ProgressBar() { finish(); }

 private:
  std::chrono::milliseconds interval() const;

  bool terminal_;
  bool open_ = false;
  Clock::time_point next_;
};

}  // namespace citylearn
