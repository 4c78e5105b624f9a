// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace citylearn {

/// A file that grows by whole records, whatever the disk does: what finds no room waits in memory and goes out when
/// there is some again, and the file never ends in a part of a record. Used by one thread.
class GrowingFile {
 public:
  /// Goes on behind what the file holds, or, when not `keep`, begins it anew. Throws Error naming the file when it
  /// cannot be opened.
  explicit GrowingFile(const std::string& path, bool keep = true);
  ~GrowingFile();  ///< tries a last time
  GrowingFile(const GrowingFile&) = delete;
  GrowingFile& operator=(const GrowingFile&) = delete;

  void add(std::string_view record);
  /// Hands what waits to the operating system. False when not all of it could be: problem() then says why.
  bool flush();
  /// Of the last flush(); empty when it went well.
  const std::string& problem() const { return problem_; }
  std::size_t waiting() const { return waiting_.size(); }  ///< bytes
  std::size_t size() const { return size_; }               ///< bytes of the file

 private:
  std::string path_, problem_;
  int file_ = -1;
  std::size_t size_ = 0;
  std::string waiting_;
  std::vector<std::size_t> ends_;  ///< of the records in waiting_
};

}  // namespace citylearn
