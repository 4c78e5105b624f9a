// SPDX-License-Identifier: Apache-2.0
#include "core/files/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace citylearn {

FileLock::FileLock(const std::string& path, const Error& held)
    : file_(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600)) {
  if (file_ < 0) throw Error(std::strerror(errno), path, "choose a folder that can be written");
  if (::flock(file_, LOCK_EX | LOCK_NB) == 0) return;
  const int fault = errno;
  ::close(file_);
  if (fault == EWOULDBLOCK) throw held;
  throw Error(std::strerror(fault), path, "choose a folder on a disk that has locks");
}

void FileLock::write(const std::string& text) {
  if (::ftruncate(file_, 0) == 0 && ::pwrite(file_, text.data(), text.size(), 0) == static_cast<ssize_t>(text.size()))
    return;
  throw Error(std::strerror(errno), "a lock file", "choose a folder on a disk that has space");
}

FileLock::~FileLock() { ::close(file_); }

}  // namespace citylearn
