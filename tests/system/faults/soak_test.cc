// SPDX-License-Identifier: Apache-2.0
// Endurance: 16 env_services of 16 agents each, a policy_service and a recorder, for half an hour: `./run test --long`.
// CITYLEARN_SOAK_MINUTES says another time. faults_test.cc kills them and counts their episodes.
#include <gtest/gtest.h>
#include <sys/types.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "tests/support/processes/trial.h"
#include "tests/support/records/witness.h"

namespace citylearn::testing {
namespace {

/// Memory and file descriptors of a process over time, as /proc tells them.
class ProcessWatch {
 public:
  ProcessWatch(std::string name, pid_t process) : name_(std::move(name)), process_(process) {}

  /// Takes a sample at `minutes` of the test. Returns false when the process is gone.
  bool look(double minutes) {
    const std::string folder = "/proc/" + std::to_string(process_);
    std::ifstream in(folder + "/statm");
    std::uint64_t all = 0, resident = 0, shared = 0;
    if (!(in >> all >> resident >> shared)) return false;
    std::error_code error;
    int files = 0;
    for (auto entry = std::filesystem::directory_iterator(folder + "/fd", error);
         !error && entry != std::filesystem::directory_iterator(); entry.increment(error))
      ++files;
    // What is shared with others is the libraries, the maps of files, and no leak.
    const double bytes = static_cast<double>(resident - shared) * static_cast<double>(sysconf(_SC_PAGESIZE));
    looks_.push_back({minutes, bytes / (1 << 20), files});
    return true;
  }
  /// MB a minute: of the straight line nearest to what was seen, without the first fifth, in which buffers fill.
  double slope() const {
    const std::size_t first = looks_.size() / 5, count = looks_.size() - first;
    if (count < 3) return 0;
    double time = 0, memory = 0;
    for (std::size_t i = first; i < looks_.size(); ++i) time += looks_[i].minutes, memory += looks_[i].megabytes;
    time /= static_cast<double>(count), memory /= static_cast<double>(count);
    double both = 0, square = 0;
    for (std::size_t i = first; i < looks_.size(); ++i) {
      both += (looks_[i].minutes - time) * (looks_[i].megabytes - memory);
      square += (looks_[i].minutes - time) * (looks_[i].minutes - time);
    }
    return square > 0 ? both / square : 0;
  }
  /// The most file descriptors in the last fifth, beyond the most in the second one.
  int more_files() const {
    const auto most = [&](std::size_t from, std::size_t to) {
      int files = 0;
      for (std::size_t i = from; i < to; ++i) files = std::max(files, looks_[i].files);
      return files;
    };
    const std::size_t count = looks_.size();
    return count < 5 ? 0 : most(count - count / 5, count) - most(count / 5, 2 * count / 5);
  }
  std::string says() const {
    if (looks_.empty()) return name_ + ": never seen";
    char text[160];
    std::snprintf(text, sizeof text, "%-12s %7.1f MB at first, %7.1f MB at last, %+6.3f MB/min, %d files",
                  name_.c_str(), looks_.front().megabytes, looks_.back().megabytes, slope(), looks_.back().files);
    return text;
  }
  const std::string& name() const { return name_; }

 private:
  struct Look {
    double minutes, megabytes;
    int files;
  };
  std::string name_;
  pid_t process_;
  std::vector<Look> looks_;
};

constexpr int kEnvironments = 16;
constexpr seconds kSampleInterval{5};
constexpr double kMaxSlope = 1;  // MB a minute

double soak_minutes() {
  const char* given = std::getenv("CITYLEARN_SOAK_MINUTES");
  return given && *given ? std::strtod(given, nullptr) : 30;
}

TEST(LongSoak, MemoryAndFilesStayFlat) {
  const double minutes = soak_minutes();
  Trial run("cyclonedds");
  Witness witness("cyclonedds", run.domain());
  const auto recorder = run.recorder(run.folder() / "dashboard.sqlite");
  std::vector<std::unique_ptr<Service>> environments;
  std::vector<ProcessWatch> watches{{"recorder", recorder->process()}};
  for (int number = 0; number < kEnvironments; ++number) {
    const std::string id = "env-" + std::to_string(number);
    environments.push_back(run.env("summer", {"--agents", "16", "--id", id, "--recorders", "dashboard"}));
    watches.emplace_back(id, environments.back()->process());
  }
  // What its wire loses is sent again after 50 ms and more: it is what keeps this from taking all of the machine.
  const auto policy = run.policy({"--middleware", "lossy,drop=0.2,repeat=0.02,reorder=0.02,seed=5:cyclonedds",
                                  "--agent", "place_filter", "--steps", "1000000000", "--checkpoint-every", "10",
                                  "--environments", std::to_string(kEnvironments), "--output", run.folder() / "out"});
  watches.emplace_back("policy", policy->process());
  ASSERT_TRUE(witness.until([&] { return witness.updates >= 3; }, kLongWait)) << policy->output();
  const Clock::time_point begin = Clock::now();
  const auto passed = [&] { return std::chrono::duration<double>(Clock::now() - begin).count() / 60; };
  while (passed() < minutes) {
    for (ProcessWatch& watch : watches) ASSERT_TRUE(watch.look(passed())) << watch.name() << " is gone";
    witness.listen(kSampleInterval);
  }
  std::printf("%.1f minutes, %zu updates heard\n", passed(), static_cast<std::size_t>(witness.updates));
  for (const ProcessWatch& watch : watches) {
    std::printf("%s\n", watch.says().c_str());
    EXPECT_LT(watch.slope(), kMaxSlope) << watch.says();
    EXPECT_LE(watch.more_files(), 0) << watch.says();
  }
}

}  // namespace
}  // namespace citylearn::testing
