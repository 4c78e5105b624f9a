// SPDX-License-Identifier: Apache-2.0
#include "core/util/processors.h"

#include <sched.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>

namespace citylearn {
namespace {

namespace fs = std::filesystem;

int processors_of_affinity() {
  for (int room = 1024; room <= 1 << 20; room *= 2) {
    cpu_set_t* const set = CPU_ALLOC(static_cast<std::size_t>(room));
    if (set == nullptr) return 1;
    const std::size_t bytes = CPU_ALLOC_SIZE(static_cast<std::size_t>(room));
    const bool known = sched_getaffinity(0, bytes, set) == 0;
    const bool too_small = !known && errno == EINVAL;
    const int count = known ? CPU_COUNT_S(bytes, set) : 1;
    CPU_FREE(set);
    if (!too_small) return count;
  }
  return 1;
}

/// Returns the processors that one control group grants; infinity where it sets no limit. Version 2 has cpu.max,
/// version 1 the other two files.
double limit_of(const fs::path& group) {
  std::string quota;
  double period = 0;
  if (std::ifstream both(group / "cpu.max"); both) {
    both >> quota >> period;
  } else {
    std::ifstream(group / "cpu.cfs_quota_us") >> quota;
    std::ifstream(group / "cpu.cfs_period_us") >> period;
  }
  const double granted = std::strtod(quota.c_str(), nullptr);  // "max" and -1 mean that there is no limit
  return granted > 0 && period > 0 ? granted / period : std::numeric_limits<double>::infinity();
}

}  // namespace

int available_processors(const std::string& root) {
  double limit = processors_of_affinity();
  std::ifstream groups(root + "/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {  // number:controllers:path
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (second == line.npos) continue;
    const std::string controllers = "," + line.substr(first + 1, second - first - 1) + ",";
    fs::path mount = root + "/sys/fs/cgroup";
    if (controllers != ",,") {  // version 1 mounts each controller by itself
      if (controllers.find(",cpu,") == controllers.npos) continue;
      mount /= "cpu";
    }
    // Each group above limits too. In a container the path may be the host's, and only the mount itself exists.
    const fs::path path = fs::path("/" + line.substr(second + 1)).lexically_normal();
    for (fs::path group = path.relative_path();; group = group.parent_path()) {
      limit = std::min(limit, limit_of(mount / group));
      if (group.empty()) break;
    }
  }
  return std::max(1, static_cast<int>(std::ceil(limit)));
}

}  // namespace citylearn
