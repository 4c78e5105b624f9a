// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/dds/middleware.h"
#include "core/util/error.h"
#include "tests/support/files.h"
#include "tests/support/wait.h"

namespace citylearn::testing {

/// Asks until `condition` holds; false when it has not within `patience` (x kSlowness).
inline bool poll_until(const std::function<bool()>& condition, milliseconds patience) {
  const Clock::time_point deadline = Clock::now() + patience * kSlowness;
  while (!condition()) {
    if (Clock::now() >= deadline) return false;
    ::poll(nullptr, 0, 5);
  }
  return true;
}

using Arguments = std::vector<std::string>;

inline Arguments operator+(Arguments command, const Arguments& more) {
  command.insert(command.end(), more.begin(), more.end());
  return command;
}

/// Another program. Killed when the test leaves it.
class Process {
 public:
  /// Takes over two descriptors that become its standard input and its outputs; -1 is this process's own.
  Process(std::vector<std::string> command, int input, int output) {
    std::vector<char*> arguments;
    for (std::string& argument : command) arguments.push_back(argument.data());
    arguments.push_back(nullptr);
    process_ = ::fork();
    if (process_ == 0) {
      if (input >= 0) ::dup2(input, STDIN_FILENO);
      if (output >= 0) ::dup2(output, STDOUT_FILENO), ::dup2(output, STDERR_FILENO);
      ::execv(arguments[0], arguments.data());
      ::_exit(127);
    }
    for (const int file : {input, output})
      if (file >= 0) ::close(file);
    if (process_ < 0) throw Error("cannot fork", command[0]);
  }
  ~Process() {
    if (process_ <= 0) return;
    ::kill(process_, SIGKILL);
    ::waitpid(process_, nullptr, 0);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void send(int signal) const {
    if (process_ > 0) ::kill(process_, signal);
  }
  /// Returns the exit status (128 + signal when killed by one), or nothing when it still runs after `patience`
  /// (x kSlowness).
  std::optional<int> wait(milliseconds patience) {
    if (process_ <= 0) return status_;
    pollfd ended{static_cast<int>(::syscall(SYS_pidfd_open, process_, 0)), POLLIN, 0};
    const int ready = ::poll(&ended, 1, static_cast<int>(patience.count()) * kSlowness);
    ::close(ended.fd);
    if (ready != 1) return std::nullopt;
    int status = 0;
    ::waitpid(process_, &status, 0);
    process_ = 0;
    return status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  pid_t process() const { return process_; }

 private:
  pid_t process_ = 0;
  int status_ = -1;
};

/// A program that runs, as the operating system or a simulation runs it.
class RunningProgram {
 public:
  virtual ~RunningProgram() = default;  ///< kills it
  virtual void send(int signal) = 0;
  /// Does what Process::wait() says.
  virtual std::optional<int> wait(milliseconds patience) = 0;
  virtual std::string output() const = 0;
  virtual pid_t process() const = 0;
};

/// A program as a process of its own, its output caught in a file.
class ForkedProgram : public RunningProgram {
 public:
  ForkedProgram(const Arguments& command, const std::string& output)
      : process_(command, ::open("/dev/null", O_RDONLY | O_CLOEXEC),
                 ::open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644)),
        output_(output) {}
  void send(int signal) override { process_.send(signal); }
  std::optional<int> wait(milliseconds patience) override { return process_.wait(patience); }
  std::string output() const override { return contents(output_); }
  pid_t process() const override { return process_.process(); }

 private:
  Process process_;
  std::string output_;
};

inline std::unique_ptr<RunningProgram> start_process(const Arguments& command, const std::string& output) {
  return std::make_unique<ForkedProgram>(command, output);
}

/// The function by which tests start programs. Those in simulation start them there
/// (tests/simulation/services/programs.cc).
inline std::unique_ptr<RunningProgram> (*start_program)(const Arguments& command,
                                                        const std::string& output) = start_process;

/// A program of the project, its output caught in a file. Killed when the test leaves it.
class Service {
 public:
  Service(const Arguments& command, const std::string& output) : program_(start_program(command, output)) {}

  void send(int signal) const { program_->send(signal); }
  std::optional<int> wait(milliseconds patience) { return program_->wait(patience); }
  /// Sends the signal and waits.
  std::optional<int> end(int signal, milliseconds patience) {
    send(signal);
    return wait(patience);
  }
  pid_t process() const { return program_->process(); }
  std::string output() const { return program_->output(); }
  bool says(const std::string& text, milliseconds patience) const {
    return poll_until([&] { return output().find(text) != std::string::npos; }, patience);
  }

 private:
  std::unique_ptr<RunningProgram> program_;
};

/// A program that ends when its standard input does.
class Child : public Process {
 public:
  explicit Child(std::vector<std::string> command) : Child(std::move(command), make_pipe()) {}
  ~Child() { finish(seconds(5)); }

  /// Lets it end and returns its exit status; -1 when it still runs after `patience` (x kSlowness).
  int finish(milliseconds patience) {
    if (input_ >= 0) ::close(input_);
    input_ = -1;
    return wait(patience).value_or(-1);
  }

 private:
  Child(std::vector<std::string> command, std::array<int, 2> ends)
      : Process(std::move(command), ends[0], -1), input_(ends[1]) {}
  static std::array<int, 2> make_pipe() {
    std::array<int, 2> ends{};
    if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw Error("no pipe");
    return ends;
  }
  int input_;
};

}  // namespace citylearn::testing
