// SPDX-License-Identifier: Apache-2.0
// The system's clocks and files as simulated processes see them. The C library's functions of these names are replaced
// in the whole program, for libraries too; threads that run no simulated process get the real ones.
#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <string>

#include "tests/simulation/machine/process.h"

namespace {

using citylearn::simulation::current_process;
using citylearn::simulation::Process;
using citylearn::simulation::Scheduler;
using citylearn::simulation::Time;

timespec to_timespec(Time time) {
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(time);
  return {static_cast<std::time_t>(seconds.count()), static_cast<long>((time - seconds).count())};
}

/// Returns whether a change to a file takes place: nothing that a dead process does may have an effect.
bool takes_place(const char* what, const char* path = "") {
  Process* process = current_process();
  if (!process) return true;
  if (!process->operate(Process::Operation::kFile)) return false;
  process->scheduler().note(what, std::strlen(what));
  if (const char* slash = std::strrchr(path, '/')) path = slash + 1;  // folders have other names in every run
  process->scheduler().note(path, std::strlen(path));
  return true;
}

ssize_t write_really(int file, const void* bytes, size_t count, const off_t* at) {
  return at ? ::syscall(SYS_pwrite64, file, bytes, count, *at) : ::syscall(SYS_write, file, bytes, count);
}

/// Writes at a place, or where the file stands.
ssize_t write_at(int file, const void* bytes, size_t count, const off_t* at) {
  Process* process = current_process();
  if (!process || file <= STDERR_FILENO) return write_really(file, bytes, count, at);
  const bool dead = process->dead();
  const bool whole = process->operate(Process::Operation::kFile);
  if (dead) return static_cast<ssize_t>(count);
  size_t part = whole ? count : count / 2;  // the kill hits in the middle of it
  if (whole) {
    process->scheduler().note(bytes, count);
    part = process->disk().take_room(count);
    if (part == 0 && count > 0) return errno = ENOSPC, -1;
  }
  struct stat about {};
  const bool appends = !at && (::fcntl(file, F_GETFL) & O_APPEND) != 0;
  if (appends) ::fstat(file, &about);
  process->disk().before_write(file, at ? *at : appends ? about.st_size : ::lseek(file, 0, SEEK_CUR), bytes, part);
  const ssize_t written = write_really(file, bytes, part, at);
  return whole ? written : static_cast<ssize_t>(count);
}

bool exists(const char* path) {
  struct stat about {};
  return ::fstatat(AT_FDCWD, path, &about, AT_SYMLINK_NOFOLLOW) == 0;
}

int remove_entry(const char* what, const char* path, bool folder) {
  if (!takes_place(what, path)) return 0;
  if (Process* process = current_process(); process && !folder) process->disk().before_removal(path);
  return static_cast<int>(::syscall(folder ? SYS_rmdir : SYS_unlink, path));
}

int resize(const char* what, int file, off_t size) {
  if (!takes_place(what)) return 0;
  if (Process* process = current_process()) process->disk().before_truncation(file, size);
  return static_cast<int>(::syscall(SYS_ftruncate, file, size));
}

int synchronise(const char* what, int file) {
  if (!takes_place(what)) return 0;
  if (Process* process = current_process()) process->disk().after_sync(file);
  return 0;  // the real disk need not be bothered
}

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  const Process* process = current_process();
  if (!process || (clock != CLOCK_MONOTONIC && clock != CLOCK_REALTIME))
    return static_cast<int>(::syscall(SYS_clock_gettime, clock, time));
  *time = to_timespec(clock == CLOCK_MONOTONIC ? process->steady_clock() : process->date());
  return 0;
}

time_t time(time_t* out) noexcept {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  if (out) *out = now.tv_sec;
  return now.tv_sec;
}

ssize_t write(int file, const void* bytes, size_t count) { return write_at(file, bytes, count, nullptr); }

ssize_t pwrite64(int file, const void* bytes, size_t count, off64_t at) { return write_at(file, bytes, count, &at); }

ssize_t pwrite(int file, const void* bytes, size_t count, off_t at) { return pwrite64(file, bytes, count, at); }

ssize_t writev(int file, const iovec* parts, int count) {
  ssize_t all = 0;
  for (int i = 0; i < count; ++i) {
    const ssize_t written = write(file, parts[i].iov_base, parts[i].iov_len);
    if (written < 0) return all > 0 ? all : written;
    all += written;
    if (static_cast<size_t>(written) < parts[i].iov_len) break;
  }
  return all;
}

int open(const char* path, int flags, ...) {
  mode_t mode = 0;
  if (flags & O_CREAT) {
    va_list arguments;
    va_start(arguments, flags);
    mode = va_arg(arguments, mode_t);
    va_end(arguments);
  }
  Process* process = current_process();
  // SQLite begins its random numbers with it, and files would differ from run to run.
  if (process && std::strcmp(path, "/dev/urandom") == 0) path = "/dev/zero";
  const bool changes = (flags & O_ACCMODE) != O_RDONLY || (flags & (O_CREAT | O_TRUNC)) != 0;
  if (!process || !changes) return static_cast<int>(::syscall(SYS_openat, AT_FDCWD, path, flags, mode));
  if (process->dead()) return static_cast<int>(::syscall(SYS_openat, AT_FDCWD, "/dev/null", flags, mode));
  const bool creates = (flags & O_CREAT) != 0 && !exists(path);
  if (creates && process->disk().full()) return errno = ENOSPC, -1;
  const int file = static_cast<int>(::syscall(SYS_openat, AT_FDCWD, path, flags & ~O_TRUNC, mode));
  if (file < 0) return file;
  if (creates)
    process->created_file(), process->disk().after_creation(path);
  else if ((flags & O_TRUNC) != 0)
    resize("truncation", file, 0);
  return file;
}

int open64(const char* path, int flags, ...) __attribute__((alias("open")));

int mkdir(const char* path, mode_t mode) noexcept {
  if (!takes_place("mkdir", path)) return 0;
  Process* process = current_process();
  if (process && process->disk().full() && !exists(path)) return errno = ENOSPC, -1;
  const int status = static_cast<int>(::syscall(SYS_mkdir, path, mode));
  if (process && status == 0) process->disk().after_creation(path);
  return status;
}

/// Names of temporary files depend on the real clock.
int mkostemp(char* pattern, int flags) {
  const Process* process = current_process();
  static int count = 0;
  std::string name(pattern);
  do {
    const int number = 1'000'000 + (process ? ++count : std::rand()) % 1'000'000;
    name.replace(name.size() - 6, 6, std::to_string(number).substr(1));
  } while (::access(name.c_str(), F_OK) == 0);
  std::strcpy(pattern, name.c_str());
  return open(pattern, O_RDWR | O_CREAT | O_EXCL | flags, 0600);
}

int link(const char* from, const char* to) noexcept {
  if (!takes_place("link", to)) return 0;
  Process* process = current_process();
  if (process && process->disk().full()) return errno = ENOSPC, -1;
  const int status = static_cast<int>(::syscall(SYS_link, from, to));
  if (process && status == 0) process->disk().after_creation(to);
  return status;
}

/// A dead process has /dev/null open instead of its file.
int fchmod(int file, mode_t mode) noexcept {
  return takes_place("fchmod") ? static_cast<int>(::syscall(SYS_fchmod, file, mode)) : 0;
}

int rename(const char* from, const char* to) noexcept {
  if (!takes_place("rename", to)) return 0;
  if (Process* process = current_process()) process->disk().before_rename(from, to);
  return static_cast<int>(::syscall(SYS_rename, from, to));
}

int unlink(const char* path) noexcept { return remove_entry("unlink", path, false); }

int rmdir(const char* path) noexcept { return remove_entry("rmdir", path, true); }

int remove(const char* path) noexcept {
  struct stat about {};
  const bool folder = ::fstatat(AT_FDCWD, path, &about, AT_SYMLINK_NOFOLLOW) == 0 && S_ISDIR(about.st_mode);
  return folder ? rmdir(path) : unlink(path);
}

int ftruncate(int file, off_t size) noexcept { return resize("ftruncate", file, size); }

int truncate(const char* path, off_t size) noexcept {
  const int file = static_cast<int>(::syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CLOEXEC));
  if (file < 0) return file;
  const int status = resize("truncate", file, size);
  ::close(file);
  return status;
}

int ftruncate64(int file, off64_t size) noexcept { return ftruncate(file, size); }

int fdatasync(int file) { return synchronise("fdatasync", file); }

int fsync(int file) { return synchronise("fsync", file); }

/// Tests wait by a poll of nothing.
int poll(pollfd* files, nfds_t count, int milliseconds) {
  Process* process = current_process();
  if (!process || count > 0 || milliseconds <= 0)
    return static_cast<int>(::syscall(SYS_poll, files, count, milliseconds));
  process->wait_until(citylearn::Clock::now() + std::chrono::milliseconds(milliseconds));
  return 0;
}

/// Numbers of files differ from run to run, and a manifest names its folder's.
int stat(const char* path, struct stat* about) noexcept {
  const int status = ::fstatat(AT_FDCWD, path, about, 0);
  if (status == 0 && current_process()) {
    about->st_ino = 1;
    for (const char* at = path; *at; ++at) about->st_ino = about->st_ino * 31 + static_cast<unsigned char>(*at);
  }
  return status;
}

}  // extern "C"
