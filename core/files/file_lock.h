// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/util/error.h"

namespace citylearn {

/// Keeps other processes off something as long as it lives. The kernel releases it however the process ends.
class FileLock {
 public:
  /// Locks the file `path`, and creates it where it is missing. Throws `held` when another process has the lock, or
  /// Error naming the file when it cannot be locked.
  FileLock(const std::string& path, const Error& held);
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;
  /// Replaces what the file says, for readers that do not lock it. It outlives the lock. Throws Error.
  void write(const std::string& text);

 private:
  int file_;
};

}  // namespace citylearn
