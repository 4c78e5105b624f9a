// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/programs.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/wire/service.h"
#include "tools/lab/descriptors.h"

extern char** environ;

namespace citylearn::lab {
namespace {

namespace fs = std::filesystem;

constexpr const char* kInterpreter = "/usr/bin/python3";  // the one that Debian's matplotlib belongs to

/// Returns the programs of an installation (bin/ and share/citylearn/tools), else those of the sources.
fs::path tools_folder() {
  std::error_code none;
  const fs::path program = fs::read_symlink("/proc/self/exe", none);
  const fs::path installed = program.parent_path().parent_path() / "share/citylearn/tools";
  return fs::is_directory(installed, none) ? installed : fs::path(CITYLEARN_TOOLS_DIR);
}

std::string last_line(const std::string& text) {
  const std::size_t end = text.find_last_not_of('\n');
  if (end == text.npos) return "ended without a message";
  const std::size_t before = text.rfind('\n', end);
  const std::size_t begin = before == text.npos ? 0 : before + 1;
  return text.substr(begin, end + 1 - begin);
}

/// A child process, killed when this object is destroyed.
class Child {
 public:
  /// Throws Error when it cannot be started. Its output goes to the file `log`.
  Child(std::vector<std::string> command, const std::string& log) {
    std::vector<char*> words;
    for (std::string& word : command) words.push_back(word.data());
    words.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions, 1, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    posix_spawn_file_actions_adddup2(&actions, 1, 2);
    const int failed = posix_spawn(&id_, words[0], &actions, nullptr, words.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    if (failed) throw Error("cannot be started: " + std::string(std::strerror(failed)), "'" + command[0] + "'");
  }
  ~Child() {
    if (status()) return;
    ::kill(id_, SIGKILL);
    while (::waitpid(id_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  /// Returns its exit status once it has ended, 128 + signal when one ended it; nothing while it runs.
  std::optional<int> status() {
    int status = 0;
    if (!status_ && ::waitpid(id_, &status, WNOHANG) == id_)
      status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return status_;
  }

 private:
  pid_t id_ = -1;
  std::optional<int> status_;
};

}  // namespace

void run_python(const std::string& program, const std::vector<std::string>& arguments) {
  const std::string path = tools_folder() / program;
  std::vector<std::string> command = {kInterpreter, "-B", path};
  command.insert(command.end(), arguments.begin(), arguments.end());
  const std::string log = fs::temp_directory_path() / ("citylearn-python-" + std::to_string(getpid()) + ".log");
  const bool stopped_before = stop_requested();
  Child child(command, log);
  while (!child.status()) {
    if (stop_requested() && !stopped_before) throw Stopped{};
    ::poll(nullptr, 0, 20);
  }
  const std::string output = read_file(log);
  fs::remove(log);
  if (child.status() == 0) return;
  if (stop_requested() && !stopped_before) throw Stopped{};
  const bool incomplete = output.find("No module named") != output.npos;
  throw Error(last_line(output), path, incomplete ? "apt-get install python3-matplotlib python3-jinja2" : "");
}

}  // namespace citylearn::lab
