// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace citylearn::testing {

/// Memory and file descriptors of a process over time, as /proc tells them.
class ProcessWatch {
 public:
  ProcessWatch(std::string name, pid_t process) : name_(std::move(name)), process_(process) {}

  /// Takes a sample at `minutes` of the test. Returns false when the process is gone.
  bool look(double minutes) {
    const std::string folder = "/proc/" + std::to_string(process_);
    std::ifstream in(folder + "/statm");
    std::uint64_t all = 0, resident = 0, shared = 0;
    if (!(in >> all >> resident >> shared)) return false;
    std::error_code error;
    int files = 0;
    for (auto entry = std::filesystem::directory_iterator(folder + "/fd", error);
         !error && entry != std::filesystem::directory_iterator(); entry.increment(error))
      ++files;
    // What is shared with others is the libraries, the maps of files, and no leak.
    const double bytes = static_cast<double>(resident - shared) * static_cast<double>(sysconf(_SC_PAGESIZE));
    looks_.push_back({minutes, bytes / (1 << 20), files});
    return true;
  }
  /// MB a minute: of the straight line nearest to what was seen, without the first fifth, in which buffers fill.
  double slope() const {
    const std::size_t first = looks_.size() / 5, count = looks_.size() - first;
    if (count < 3) return 0;
    double time = 0, memory = 0;
    for (std::size_t i = first; i < looks_.size(); ++i) time += looks_[i].minutes, memory += looks_[i].megabytes;
    time /= static_cast<double>(count), memory /= static_cast<double>(count);
    double both = 0, square = 0;
    for (std::size_t i = first; i < looks_.size(); ++i) {
      both += (looks_[i].minutes - time) * (looks_[i].megabytes - memory);
      square += (looks_[i].minutes - time) * (looks_[i].minutes - time);
    }
    return square > 0 ? both / square : 0;
  }
  /// The most file descriptors in the last fifth, beyond the most in the second one.
  int more_files() const {
    const auto most = [&](std::size_t from, std::size_t to) {
      int files = 0;
      for (std::size_t i = from; i < to; ++i) files = std::max(files, looks_[i].files);
      return files;
    };
    const std::size_t count = looks_.size();
    return count < 5 ? 0 : most(count - count / 5, count) - most(count / 5, 2 * count / 5);
  }
  std::string says() const {
    if (looks_.empty()) return name_ + ": never seen";
    char text[160];
    std::snprintf(text, sizeof text, "%-12s %7.1f MB at first, %7.1f MB at last, %+6.3f MB/min, %d files",
                  name_.c_str(), looks_.front().megabytes, looks_.back().megabytes, slope(), looks_.back().files);
    return text;
  }
  const std::string& name() const { return name_; }

 private:
  struct Look {
    double minutes, megabytes;
    int files;
  };
  std::string name_;
  pid_t process_;
  std::vector<Look> looks_;
};

}  // namespace citylearn::testing
