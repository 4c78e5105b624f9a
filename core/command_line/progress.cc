// SPDX-License-Identifier: Apache-2.0
#include "core/command_line/progress.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <cmath>
#include <iostream>

#include "core/util/log_format.h"

namespace citylearn {

std::string clock_time(double seconds) {
  const long all = std::lround(std::ceil(seconds));
  if (all < 3600) return fmt::format("{}:{:02}", all / 60, all % 60);
  return fmt::format("{}:{:02}:{:02}", all / 3600, all / 60 % 60, all % 60);
}

Progress::Progress(std::string what, int total)
    : what_(std::move(what)),
      total_(total),
      terminal_(isatty(STDERR_FILENO) != 0 && !is_json_log()),
      start_(Clock::now()) {
  spoke_ = start_;
}

Progress::~Progress() {
  if (shown_ && terminal_) std::cerr << "\r\033[K" << std::flush;
}

void Progress::done(int count) {
  done_ += count;
  if (seconds_since(start_) < 2 || seconds_since(spoke_) < (terminal_ ? 0.2 : 10) || done_ == 0) return;
  const double left = seconds_since(start_) / done_ * (total_ - done_);
  const std::string text =
      what_ + ": " + std::to_string(done_) + " of " + std::to_string(total_) + ", " + clock_time(left) + " left";
  if (terminal_)
    std::cerr << "\r\033[K" << text << std::flush;
  else
    print_line(text);
  spoke_ = Clock::now();
  shown_ = true;
}

}  // namespace citylearn
