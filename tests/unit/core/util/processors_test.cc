// SPDX-License-Identifier: Apache-2.0
#include "core/util/processors.h"

#include <gtest/gtest.h>
#include <sched.h>

#include <map>
#include <thread>

#include "tests/support/files.h"

namespace citylearn::testing {
namespace {

/// Returns the processors of a thread with these files below the root, which may run on any processor.
int processors_with(const std::map<std::string, std::string>& files) {
  const Folder root;
  for (const auto& [path, text] : files) make_file(root / path, text);
  return available_processors(root.path());
}

TEST(Processors, AreThoseOfTheAffinity) {
  const int all = processors_with({});
  EXPECT_GE(all, 1);
  EXPECT_LE(available_processors(), all);
  int pinned = 0;
  std::thread([&pinned] {
    cpu_set_t set;
    ASSERT_EQ(sched_getaffinity(0, sizeof set, &set), 0);
    int first = 0;
    while (!CPU_ISSET(first, &set)) ++first;
    CPU_ZERO(&set);
    CPU_SET(first, &set);
    ASSERT_EQ(sched_setaffinity(0, sizeof set, &set), 0);
    pinned = processors_with({});
  }).join();
  EXPECT_EQ(pinned, 1);
}

TEST(Processors, AreFewerWhereAControlGroupLimitsThem) {
  const int all = processors_with({});
  const std::string self = "proc/self/cgroup", two = "0::/a/b\n", mount = "sys/fs/cgroup/";
  EXPECT_EQ(processors_with({{self, two}, {mount + "a/b/cpu.max", "50000 100000\n"}}), 1);
  EXPECT_EQ(processors_with({{self, two}, {mount + "a/cpu.max", "100000 100000\n"}}), 1) << "a group above";
  EXPECT_EQ(processors_with({{self, two}, {mount + "cpu.max", "100000 100000\n"}}), 1) << "the mount of a container";
  EXPECT_EQ(processors_with({{self, "0::/../other\n"}, {mount + "cpu.max", "10000 100000\n"}}), 1);
  EXPECT_EQ(processors_with({{self, two}, {mount + "c/cpu.max", "10000 100000\n"}}), all) << "another group's";
  EXPECT_EQ(processors_with({{self, two}, {mount + "a/b/cpu.max", "max 100000\n"}}), all);
  EXPECT_EQ(processors_with({{self, two}, {mount + "a/b/cpu.max", "garbage\n"}}), all);
  EXPECT_EQ(processors_with({{self, "nothing\n:\n"}}), all);
  if (all > 1) {
    EXPECT_EQ(processors_with({{self, two}, {mount + "a/b/cpu.max", "150000 100000\n"}}), 2);
  }
}

TEST(Processors, AreFewerWhereAControlGroupOfVersionOneLimitsThem) {
  const int all = processors_with({});
  const std::string self = "proc/self/cgroup", groups = "3:memory:/a\n2:cpu,cpuacct:/a\n0::/\n";
  const auto limited = [&](const std::string& folder, const std::string& quota) {
    return processors_with({{self, groups},
                            {"sys/fs/cgroup/" + folder + "/cpu.cfs_quota_us", quota},
                            {"sys/fs/cgroup/" + folder + "/cpu.cfs_period_us", "100000\n"}});
  };
  EXPECT_EQ(limited("cpu/a", "20000\n"), 1);
  EXPECT_EQ(limited("cpu", "20000\n"), 1);
  EXPECT_EQ(limited("cpu/a", "-1\n"), all);
  EXPECT_EQ(limited("memory/a", "20000\n"), all);
}

}  // namespace
}  // namespace citylearn::testing
