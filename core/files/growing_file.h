// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace citylearn {

/// A file that grows by whole records. Records for which the disk has no room wait in memory until it has, and the file
/// never ends with part of a record. Used by one thread.
class GrowingFile {
 public:
  /// Appends to the file, or empties it first unless `keep`. Throws Error naming the file when it cannot be opened.
  explicit GrowingFile(const std::string& path, bool keep = true);
  ~GrowingFile();  ///< flushes once more
  GrowingFile(const GrowingFile&) = delete;
  GrowingFile& operator=(const GrowingFile&) = delete;

  void add(std::string_view record);
  /// Hands waiting records to the operating system. Returns false when some still wait; problem() then says why.
  bool flush();
  /// Does the same, and waits until all records are on the disk, so that they survive a loss of power.
  bool sync();
  /// Returns why the last flush() or sync() failed; empty when it did not.
  const std::string& problem() const { return problem_; }
  std::size_t waiting() const { return waiting_.size(); }  ///< bytes
  std::size_t size() const { return size_; }               ///< bytes of the file

 private:
  std::string path_, problem_;
  int file_ = -1;
  bool synced_ = false, folder_synced_ = false;
  std::size_t size_ = 0;
  std::string waiting_;
  std::vector<std::size_t> ends_;  ///< of the records in waiting_
};

}  // namespace citylearn
