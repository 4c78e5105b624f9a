// SPDX-License-Identifier: Apache-2.0
#include "core/files/growing_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "core/files/files.h"
#include "core/util/error.h"

namespace citylearn {

GrowingFile::GrowingFile(const std::string& path, bool keep) : path_(path) {
  refuse_special_file(path);
  file_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC | (keep ? 0 : O_TRUNC), 0644);
  struct stat about {};
  if (file_ < 0 || ::fstat(file_, &about) != 0) {
    const std::string why = std::strerror(errno);
    if (file_ >= 0) ::close(file_);
    throw Error(why, path, "choose another --output");
  }
  size_ = static_cast<std::size_t>(about.st_size);
}

GrowingFile::~GrowingFile() {
  flush();
  ::close(file_);
}

void GrowingFile::add(std::string_view record) {
  waiting_ += record;
  ends_.push_back(waiting_.size());
}

bool GrowingFile::flush() {
  problem_.clear();
  std::size_t written = 0;
  while (written < waiting_.size()) {
    const ssize_t count = ::write(file_, waiting_.data() + written, waiting_.size() - written);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) {
      problem_ = path_ + ": " + std::strerror(errno) + "; what is not written waits (free some space)";
      break;
    }
    written += static_cast<std::size_t>(count);
    synced_ = false;
  }
  const auto whole = std::upper_bound(ends_.begin(), ends_.end(), written);
  const std::size_t kept = whole == ends_.begin() ? 0 : *std::prev(whole);
  size_ += kept;
  // The part of a record goes, so that the file is whole while the rest waits.
  if (written > kept && ::ftruncate(file_, static_cast<off_t>(size_)) != 0 && problem_.empty())
    problem_ = path_ + ": " + std::strerror(errno);
  waiting_.erase(0, kept);
  ends_.erase(ends_.begin(), whole);
  for (std::size_t& end : ends_) end -= kept;
  return problem_.empty();
}

bool GrowingFile::sync() {
  const bool flushed = flush();
  if (synced_) return flushed;
  if (::fdatasync(file_) != 0) {
    problem_ = path_ + ": " + std::strerror(errno);
    return false;
  }
  if (!folder_synced_) sync_folder_of(path_);
  synced_ = folder_synced_ = true;
  return flushed;
}

}  // namespace citylearn
