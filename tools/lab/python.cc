// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/python.h"

#include <poll.h>
#include <unistd.h>

#include <filesystem>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/wire/service.h"
#include "tools/lab/child.h"
#include "tools/lab/descriptors.h"

namespace citylearn::lab {
namespace {

namespace fs = std::filesystem;

constexpr const char* kInterpreter = "/usr/bin/python3";  // the one that Debian's matplotlib belongs to

/// The programs of an installation (bin/ and share/citylearn/tools), else those of the sources.
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
