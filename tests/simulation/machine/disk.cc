// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/machine/disk.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>

#include "core/util/error.h"

namespace citylearn::simulation {
namespace {

// The system's own functions: those of these names are replaced by system_calls.cc.

int open_really(const char* path, int flags) {
  return static_cast<int>(::syscall(SYS_openat, AT_FDCWD, path, flags, 0600));
}

void write_really(int file, std::string_view bytes, off_t at) {
  if (!bytes.empty() && ::syscall(SYS_pwrite64, file, bytes.data(), bytes.size(), at) < 0)
    throw Error(std::strerror(errno), "simulated disk");
}

void truncate_really(int file, off_t size) { ::syscall(SYS_ftruncate, file, size); }
void rename_really(const std::string& from, const std::string& to) { ::syscall(SYS_rename, from.c_str(), to.c_str()); }
void remove_really(const std::string& path) {
  if (::syscall(SYS_unlink, path.c_str()) != 0) ::syscall(SYS_rmdir, path.c_str());
}

std::string read_part(int file, off_t at, off_t count) {
  std::string bytes(static_cast<std::size_t>(std::max<off_t>(count, 0)), '\0');
  const ssize_t got = ::pread(file, bytes.data(), bytes.size(), at);
  bytes.resize(static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
  return bytes;
}

std::string name_of(int file) {
  char name[4096];
  const ssize_t count = ::readlink(("/proc/self/fd/" + std::to_string(file)).c_str(), name, sizeof name);
  return {name, static_cast<std::size_t>(std::max<ssize_t>(count, 0))};
}

/// Returns the absolute name of the folder that has an entry of this path.
std::string folder_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  const int folder = open_really(slash == path.npos ? "."
                                 : slash == 0       ? "/"
                                                    : path.substr(0, slash).c_str(),
                                 O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder < 0) return "";
  std::string name = name_of(folder);
  ::close(folder);
  return name;
}

}  // namespace

Disk::Disk(const std::string& host) : kept_folder_(".disk-" + host) {}

Disk::~Disk() {
  for (const File& file : files_) ::close(file.descriptor);
}

void Disk::remember_changes(std::uint64_t seed) {
  remembers_ = true;
  random_ = Random{seed, 0xD15C};
  ::syscall(SYS_mkdir, kept_folder_.c_str(), 0700);
}

std::size_t Disk::take_room(std::size_t bytes) {
  if (!full_) return bytes;
  const std::size_t taken = std::min(bytes, room_);
  room_ -= taken;
  return taken;
}

std::list<Disk::File>::iterator Disk::find(std::uint64_t inode) {
  return std::find_if(files_.begin(), files_.end(), [inode](const File& file) { return file.inode == inode; });
}

/// Returns null unless changes to this file are remembered.
Disk::File* Disk::remembered(int file) {
  struct stat about {};
  if (!remembers_ || ::fstat(file, &about) != 0 || !S_ISREG(about.st_mode)) return nullptr;
  if (const auto known = find(about.st_ino); known != files_.end()) return &*known;
  const int own = open_really(("/proc/self/fd/" + std::to_string(file)).c_str(), O_RDWR | O_CLOEXEC);
  if (own < 0) return nullptr;
  return &files_.emplace_back(File{about.st_ino, own, {}});
}

void Disk::before_write(int file, off_t at, const void* bytes, std::size_t count) {
  File* known = remembered(file);
  if (!known) return;
  struct stat about {};
  ::fstat(file, &about);
  const off_t end = std::min(about.st_size, at + static_cast<off_t>(count));
  known->changes.push_back({at, about.st_size, read_part(known->descriptor, at, end - at),
                            std::string(static_cast<const char*>(bytes), count), false});
}

void Disk::before_truncation(int file, off_t size) {
  File* known = remembered(file);
  if (!known) return;
  struct stat about {};
  ::fstat(file, &about);
  known->changes.push_back(
      {size, about.st_size, read_part(known->descriptor, size, about.st_size - size), std::string(), true});
}

/// Returns another name of the file, which it keeps when this one goes.
std::string Disk::keep(const std::string& path) {
  std::string kept = kept_folder_ + "/" + std::to_string(++kept_);
  return ::syscall(SYS_link, path.c_str(), kept.c_str()) == 0 ? kept : "";
}

void Disk::before_rename(const std::string& from, const std::string& to) {
  if (!remembers_) return;
  const std::string kept = keep(to);
  entries_.push_back({folder_of(to),
                      [from, to, kept] {
                        rename_really(to, from);
                        if (!kept.empty()) rename_really(kept, to);
                      },
                      kept});
}

void Disk::before_removal(const std::string& path) {
  if (!remembers_) return;
  if (const std::string kept = keep(path); !kept.empty())
    entries_.push_back({folder_of(path), [path, kept] { rename_really(kept, path); }, kept});
}

void Disk::after_creation(const std::string& path) {
  if (remembers_) entries_.push_back({folder_of(path), [path] { remove_really(path); }, ""});
}

void Disk::forget(Entry& entry) {
  if (!entry.kept.empty()) remove_really(entry.kept);
}

void Disk::after_sync(int file) {
  struct stat about {};
  if (!remembers_ || ::fstat(file, &about) != 0) return;
  if (S_ISDIR(about.st_mode)) {
    const std::string name = name_of(file);
    entries_.remove_if([&](Entry& entry) {
      if (entry.folder != name) return false;
      forget(entry);
      return true;
    });
  } else if (const auto known = find(about.st_ino); known != files_.end()) {
    ::close(known->descriptor);
    files_.erase(known);
  }
}

/// The kernel writes a file's pages in any order, but mostly in the one in which they came.
void Disk::lose_writes(const File& file) {
  for (auto change = file.changes.rbegin(); change != file.changes.rend(); ++change) {
    truncate_really(file.descriptor, change->size_before);
    write_really(file.descriptor, change->before, change->at);
  }
  const std::uint64_t kind = random_.below(4);  // none is left, all, the first ones, or any
  const std::uint64_t first = random_.below(file.changes.size() + 1);
  std::uint64_t number = 0;
  for (const Change& change : file.changes) {
    ++number;
    const bool left = kind == 1 || (kind == 2 && number <= first) || (kind == 3 && random_.below(2) == 0);
    if (!left) continue;
    if (change.truncation) {
      truncate_really(file.descriptor, change.at);
      continue;
    }
    const bool torn = kind >= 2 && random_.below(4) == 0;
    const std::size_t count = torn ? random_.below(change.after.size() + 1) : change.after.size();
    write_really(file.descriptor, std::string_view(change.after).substr(0, count), change.at);
  }
}

void Disk::power_on() {
  if (!off_) return;
  off_ = false;
  for (const File& file : files_) {
    lose_writes(file);
    ::close(file.descriptor);
  }
  files_.clear();
  // A file system with a journal brings changes to folders to the disk in their order.
  for (std::uint64_t left = random_.below(entries_.size() + 1); left > 0; --left) {
    forget(entries_.front());
    entries_.pop_front();
  }
  for (; !entries_.empty(); entries_.pop_back()) entries_.back().undo();
}

}  // namespace citylearn::simulation
