// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/progress_bar.h"

#include <spdlog/fmt/fmt.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <iostream>

#include "core/util/log_format.h"

namespace citylearn {

std::chrono::milliseconds ProgressBar::interval() const {
  return terminal_ ? std::chrono::milliseconds(200) : std::chrono::milliseconds(5000);
}

ProgressBar::ProgressBar() : terminal_(isatty(STDERR_FILENO) == 1 && !is_json_log()) { finish(); }

void ProgressBar::show(const std::string& what, double fraction, double rate, double left, const std::string& note) {
  const Clock::time_point now = Clock::now();
  fraction = std::clamp(fraction, 0.0, 1.0);
  if (now < next_ && (terminal_ ? fraction < 1 : true)) return;
  next_ = now + interval();
  std::string line = fmt::format(" {:3.0f} %  {:.0f} steps/s  {}", 100 * fraction, rate, note);
  if (left >= 0) line += fmt::format("  {:.0f} s left", left);
  if (!terminal_) {
    print_line(what + line);
    return;
  }
  winsize size{};
  const int columns = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
  const int width = std::clamp(columns - static_cast<int>(what.size() + line.size()) - 4, 0, 40);
  const int filled = static_cast<int>(fraction * width);
  std::string bar = width > 4 ? " [" + std::string(filled, '#') + std::string(width - filled, '.') + "]" : "";
  std::cerr << "\r\033[K" << what << bar
            << line.substr(0, std::max(0, columns - 1 - static_cast<int>(what.size() + bar.size()))) << std::flush;
  open_ = true;
}

void ProgressBar::finish() {
  if (open_) std::cerr << std::endl;
  open_ = false;
  // Work that ends within the first interval leaves no line in a log.
  next_ = Clock::now() + (terminal_ ? std::chrono::milliseconds(0) : interval());
}

}  // namespace citylearn
