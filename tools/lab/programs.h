// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <vector>

namespace citylearn::lab {

/// A child process, killed when this object is destroyed.
class Child {
 public:
  /// command[0] is a path, or a name to find in PATH. Its output goes to the file `log`, which may be "/dev/null".
  /// Throws Error when it cannot be started.
  Child(std::vector<std::string> command, const std::string& log);
  ~Child();
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  /// Returns its exit status once it has ended, 128 + signal when one ended it; nothing while it runs.
  std::optional<int> status();
  pid_t id() const { return id_; }

 private:
  pid_t id_ = -1;
  std::optional<int> status_;
};

/// Runs one of this project's Python programs, named by its path below tools/, with Debian's interpreter, and waits for
/// its end. Throws Error with the last line that it printed when it fails, Stopped when Ctrl-C arrives meanwhile.
void run_python(const std::string& program, const std::vector<std::string>& arguments);

}  // namespace citylearn::lab
