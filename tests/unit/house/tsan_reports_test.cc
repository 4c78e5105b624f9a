// SPDX-License-Identifier: Apache-2.0
// Which reports of ThreadSanitizer count (tests/support/tsan_reports.awk).
#include <gtest/gtest.h>

#include <fstream>

#include "tests/paths.h"
#include "tests/support/processes/hosts.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

const std::string kFree = "    #0 free tsan_interceptors_posix.cpp:706 (libtsan.so.2+0x47e82)\n";
const std::string kCyclone = "    #1 ddsrt_free <null> (libddsc.so.0debian+0xdabc8)\n";
const std::string kCopy =
    "    #1 std::copy(char const*) /usr/include/c++/12/bits/stl_algobase.h:620 (policy_service+0x1)\n";
const std::string kOurs =
    "    #2 citylearn::EnvClient::spin() ../../policy_service/env_client.cc:103 (policy_service+0xcc762)\n";
const std::string kLost = "    [failed to restore the stack]\n";

std::string race(const std::string& stack, const std::string& previous) {
  return "==================\nWARNING: ThreadSanitizer: data race (pid=1)\n  Write of size 8 at 0x7b by thread T1:\n" +
         stack + "\n  Previous atomic read of size 4 at 0x7b by main thread:\n" + previous +
         "\n  Thread T1 (tid=2, running) created by main thread at:\n" + kOurs +
         "\nSUMMARY: ThreadSanitizer: data race in free\n==================\n";
}

std::string cycle(const std::string& first, const std::string& second) {
  return "WARNING: ThreadSanitizer: lock-order-inversion (potential deadlock) (pid=1)\n"
         "  Mutex M2 acquired here while holding mutex M1 in main thread:\n" +
         first + "\n  Mutex M1 acquired here while holding mutex M2 in main thread:\n" + second +
         "\nSUMMARY: ThreadSanitizer: lock-order-inversion in lock\n";
}

/// Returns how many of the reports count.
int counted(const std::string& reports) {
  const Folder folder;
  std::ofstream(folder / "report.1") << reports;
  return occurrences(shell("awk -f " CITYLEARN_SOURCE_DIR "/tests/support/tsan_reports.awk " + (folder / "report.1")),
                     "SUMMARY");
}

TEST(TsanReports, OfLibrariesAloneDoNotCount) {
  EXPECT_EQ(counted(race(kFree + kCyclone, kFree + kCyclone)), 0);
  EXPECT_EQ(counted(race(kFree + kCyclone, kLost)), 0);
  EXPECT_EQ(counted(race(kFree + kCopy + kCyclone, kFree + kCyclone)), 0) << "the C++ library is nobody's";
  EXPECT_EQ(counted(cycle(kFree + kCyclone + kOurs, kFree + kCyclone)), 0) << "called by us, locked by them";
}

TEST(TsanReports, WithOurCodeOnEitherSideCount) {
  EXPECT_EQ(counted(race(kFree + kCyclone, kFree + kCopy + kOurs)), 1);
  EXPECT_EQ(counted(race(kFree + kOurs, kFree + kCyclone)), 1);
  EXPECT_EQ(counted(race(kFree + kOurs, kLost)), 1);
  EXPECT_EQ(counted(cycle(kFree + kCyclone, kFree + kOurs)), 1);
  EXPECT_EQ(counted("WARNING: ThreadSanitizer: double lock of a mutex (pid=1)\n" + kFree + kCyclone + "\nSUMMARY: x\n"),
            1);
  EXPECT_EQ(counted(race(kFree + kOurs, kOurs) + race(kFree + kCyclone, kFree + kCyclone) + race(kFree, kFree)), 2);
}

}  // namespace
}  // namespace citylearn::testing
