// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/dds/middleware.h"

namespace citylearn {

/// Progress for people on standard error: a bar that stays on its line on a terminal, plain lines every few seconds
/// elsewhere.
class Progress {
 public:
  Progress();
  /// `share` 0..1, `rate` in steps per second, `left` in seconds (negative: unknown), `note` with the figures of the
  /// moment.
  void show(const std::string& what, double share, double rate, double left, const std::string& note);
  /// Ends the bar's line.
  void finish();

 private:
  std::chrono::milliseconds pause() const;

  bool terminal_;
  bool open_ = false;
  Clock::time_point next_;
};

}  // namespace citylearn
