// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <list>
#include <string>

#include "core/util/random.h"

namespace citylearn::simulation {

/// The disk of a simulated host. It may be full for a while, and with the power it loses what was not synchronised:
/// of the unsynchronised writes to a file none, some or all are left, whole or in part, and of the files created,
/// renamed and removed since their folder was synchronised only the first few. system_calls.cc announces each change
/// before it is made.
class Disk {
 public:
  explicit Disk(const std::string& host);
  ~Disk();
  Disk(const Disk&) = delete;
  Disk& operator=(const Disk&) = delete;

  /// Must be called before anything is written, if the power is to be lost later.
  void remember_changes(std::uint64_t seed);
  /// Makes the disk take `room` more bytes and no new files.
  void fill(std::size_t room) { full_ = true, room_ = room; }
  void empty() { full_ = false; }
  bool full() const { return full_; }
  /// Returns how many of so many bytes find room.
  std::size_t take_room(std::size_t bytes);

  void before_write(int file, off_t at, const void* bytes, std::size_t count);
  void before_truncation(int file, off_t size);
  void before_rename(const std::string& from, const std::string& to);
  void before_removal(const std::string& path);
  void after_creation(const std::string& path);  ///< of a file or folder
  void after_sync(int file);                     ///< of a file or folder

  /// The power goes, once the process is dead; what is lost shows when it comes back.
  void power_off() { off_ = remembers_; }
  /// Does nothing unless the power was off.
  void power_on();

 private:
  struct Change {  ///< of a file's contents, from a place on
    off_t at, size_before;
    std::string before, after;
    bool truncation;
  };
  struct File {
    std::uint64_t inode;
    int descriptor;
    std::list<Change> changes;
  };
  struct Entry {  ///< a change to a folder
    std::string folder;
    std::function<void()> undo;
    std::string kept;  ///< a name of the file that is gone; may be empty
  };
  std::list<File>::iterator find(std::uint64_t inode);
  File* remembered(int file);
  std::string keep(const std::string& path);
  void lose_writes(const File& file);
  void forget(Entry& entry);

  const std::string kept_folder_;
  bool remembers_ = false, full_ = false, off_ = false;
  std::size_t room_ = 0;
  std::uint64_t kept_ = 0;
  Random random_;
  std::list<File> files_;
  std::list<Entry> entries_;
};

}  // namespace citylearn::simulation
