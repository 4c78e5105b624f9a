// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "core/util/error.h"
#include "core/dds/middleware.h"
#include "tests/support/wait.h"

namespace citylearn::testing {

/// Another program, told to end by the end of its standard input.
class Child {
 public:
  explicit Child(std::vector<std::string> command) {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw Error("no pipe", command[0]);
    std::vector<char*> arguments;
    for (std::string& argument : command) arguments.push_back(argument.data());
    arguments.push_back(nullptr);
    process_ = fork();
    if (process_ == 0) {
      dup2(ends[0], STDIN_FILENO);
      execv(arguments[0], arguments.data());
      _exit(127);
    }
    close(ends[0]);
    input_ = ends[1];
    if (process_ < 0) throw Error("cannot fork", command[0]);
  }
  ~Child() { finish(std::chrono::seconds(5)); }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  /// Lets it end, by force after `patience`, and returns its exit status; -1 when it did not end well.
  int finish(std::chrono::milliseconds patience) {
    if (input_ >= 0) close(input_);
    input_ = -1;
    if (process_ <= 0) return status_;
    pollfd ended{static_cast<int>(syscall(SYS_pidfd_open, process_, 0)), POLLIN, 0};
    if (poll(&ended, 1, static_cast<int>(patience.count()) * kSlowness) != 1) kill(process_, SIGKILL);
    close(ended.fd);
    int status = 0;
    waitpid(process_, &status, 0);
    process_ = 0;
    return status_ = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  pid_t process_ = 0;
  int input_ = -1;
  int status_ = -1;
};

}  // namespace citylearn::testing
