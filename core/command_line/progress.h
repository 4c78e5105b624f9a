// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/util/types.h"

namespace citylearn {

/// "hog winter: 1200 of 3576, 0:42 left" on standard error: rewritten in place on a terminal, else a line every 10 s.
/// Prints nothing for work of less than two seconds.
class Progress {
 public:
  Progress(std::string what, int total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  void done(int count);

 private:
  std::string what_;
  int total_, done_ = 0;
  bool terminal_, shown_ = false;
  Clock::time_point start_, spoke_;
};

/// "1:05:09", "3:20".
std::string clock_time(double seconds);

}  // namespace citylearn
