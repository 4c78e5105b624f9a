// SPDX-License-Identifier: Apache-2.0
// The system's clocks and files as simulated processes see them. The C library's functions of these names are replaced
// in the whole program, for libraries too; threads that run no simulated process get the real ones.
#include <fcntl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <ctime>

#include "tests/simulation/process.h"

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
  if (!process->operate()) return false;
  process->scheduler().note(what, std::strlen(what));
  if (const char* slash = std::strrchr(path, '/')) path = slash + 1;  // folders have other names in every run
  process->scheduler().note(path, std::strlen(path));
  return true;
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

ssize_t write(int file, const void* bytes, size_t count) {
  Process* process = current_process();
  if (!process || file <= STDERR_FILENO) return ::syscall(SYS_write, file, bytes, count);
  const bool dead = process->dead();
  if (process->operate()) {
    process->scheduler().note(bytes, count);
    return ::syscall(SYS_write, file, bytes, count);
  }
  if (!dead) ::syscall(SYS_write, file, bytes, count / 2);  // the kill hits in the middle of it
  return static_cast<ssize_t>(count);
}

ssize_t pwrite64(int file, const void* bytes, size_t count, off64_t at) {
  Process* process = current_process();
  const bool dead = process && process->dead();
  if (!process || process->operate()) return ::syscall(SYS_pwrite64, file, bytes, count, at);
  if (!dead) ::syscall(SYS_pwrite64, file, bytes, count / 2, at);
  return static_cast<ssize_t>(count);
}

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
  const Process* process = current_process();
  const bool changes = (flags & O_ACCMODE) != O_RDONLY || (flags & (O_CREAT | O_TRUNC)) != 0;
  if (process && process->dead() && changes) path = "/dev/null";
  return static_cast<int>(::syscall(SYS_openat, AT_FDCWD, path, flags, mode));
}

int open64(const char* path, int flags, ...) __attribute__((alias("open")));

int rename(const char* from, const char* to) noexcept {
  return takes_place("rename", to) ? static_cast<int>(::syscall(SYS_rename, from, to)) : 0;
}

int unlink(const char* path) noexcept {
  return takes_place("unlink", path) ? static_cast<int>(::syscall(SYS_unlink, path)) : 0;
}

int ftruncate(int file, off_t size) noexcept {
  return takes_place("ftruncate") ? static_cast<int>(::syscall(SYS_ftruncate, file, size)) : 0;
}

int truncate(const char* path, off_t size) noexcept {
  return takes_place("truncate", path) ? static_cast<int>(::syscall(SYS_truncate, path, size)) : 0;
}

int ftruncate64(int file, off64_t size) noexcept { return ftruncate(file, size); }

int fdatasync(int file) { return takes_place("fdatasync") ? static_cast<int>(::syscall(SYS_fdatasync, file)) : 0; }

int fsync(int file) { return takes_place("fsync") ? static_cast<int>(::syscall(SYS_fsync, file)) : 0; }

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
