// SPDX-License-Identifier: Apache-2.0
// The times of the wire stand in core/exchange/timing.h, where the compiler checks what must hold between them.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <regex>
#include <string>
#include <vector>

#include "tests/paths.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

const fs::path kSourceRoot = CITYLEARN_SOURCE_DIR;

/// Folders with what speaks on the wire.
const std::vector<std::string> kFolders = {"core/exchange",   "core/wire",      "core/recording", "env_service",
                                           "encoder_service", "policy_service", "dashboard",      "tools/record",
                                           "tools/ros2",      "python"};

/// Times of something else: in files whose path begins with `path`, on lines that contain `text`.
struct Exception {
  std::string path, text, reason;
};
const std::vector<Exception> kExceptions = {
    {"core/exchange/timing.h", "", "the table itself"},
    {"core/recording/replay_clock.cc", "kOrigin", "a point in time"},
    {"core/wire/service.cc", "kMemoryCheckInterval", "memory of this process"},
    {"dashboard/http/", "", "HTTP"},
    {"dashboard/live/pictures.cc", "spare_rate", "follows from a rate"},
    {"dashboard/live/route_archive.h", "", "pictures on the disk"},
    {"dashboard/live/runs_feed.h", "period", "messages to the page"},
    {"dashboard/live/service_list.h", "kRemovalDelay", "what the page lists"},
    {"encoder_service/encoders/python.cc", "kEndInterval", "a process on this machine"},
    {"encoder_service/pipeline/encoding_pipeline.cc", "kProgressInterval", "lines of the log"},
    {"encoder_service/pipeline/traversal_work.cc", "kStorePollInterval", "features on the disk"},
    {"env_service/live/robot.cc", "", "ROS 2"},
    {"policy_service/run/progress_bar.cc", "", "the terminal"},
    {"policy_service/run/run_context.cc", "next_log", "lines of the log"},
    {"policy_service/run/training_run.cc", "next_log", "lines of the log"},
};

/// Returns a line of code without its comment and the contents of its texts.
std::string code_of(const std::string& line) {
  static const std::regex comment("//.*"), text(R"("(\\.|[^"\\])*")");
  return std::regex_replace(std::regex_replace(line, text, "\"\""), comment, "");
}

TEST(Timing, OfTheWireStandsInOneTable) {
  const std::regex time(
      R"(\b(micro|milli)?(seconds|minutes|hours)\b>?\s*\w*\s*[({]\s*[1-9]|\b[1-9][0-9']*(us|ms|s|min)\b)");
  std::vector<int> used(kExceptions.size());
  for (const std::string& folder : kFolders)
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(kSourceRoot / folder)) {
      const std::string path = fs::relative(entry.path(), kSourceRoot), extension = entry.path().extension();
      if ((extension != ".h" && extension != ".cc") || path.find("/node_modules/") != path.npos) continue;
      for (const std::string& line : lines_of(contents(entry.path()))) {
        if (!std::regex_search(code_of(line), time)) continue;
        const auto exception = std::find_if(kExceptions.begin(), kExceptions.end(), [&](const Exception& known) {
          return path.starts_with(known.path) && line.find(known.text) != line.npos;
        });
        if (exception != kExceptions.end())
          ++used[static_cast<std::size_t>(exception - kExceptions.begin())];
        else
          ADD_FAILURE() << path << ": " << line << "\nput it into core/exchange/timing.h, with what must hold for it";
      }
    }
  for (std::size_t i = 0; i < used.size(); ++i)
    EXPECT_GT(used[i], 0) << "nothing in " << kExceptions[i].path << " needs the exception for "
                          << kExceptions[i].reason;
}

}  // namespace
}  // namespace citylearn::testing
