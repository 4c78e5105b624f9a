// SPDX-License-Identifier: Apache-2.0
#include "core/files/files.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "core/files/growing_file.h"
#include "core/files/safetensors.h"
#include "core/recording/mcap.h"
#include "policy_service/records/episode_log.h"
#include "policy_service/records/metrics_log.h"
#include "tests/support/files.h"
#include "tests/support/text.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

/// Opening a FIFO waits for the other end, for ever.
TEST(Files, AFifoIsRefusedInsteadOfWaitedFor) {
  const Folder folder;
  const std::string fifo = folder / "fifo";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  const std::vector<std::pair<std::string, std::function<void()>>> readers = {
      {"read_file", [&] { read_file(fifo); }},           {"GrowingFile", [&] { GrowingFile(fifo, true); }},
      {"McapReader", [&] { McapReader reader(fifo); }},  {"EpisodeLog", [&] { EpisodeLog log(fifo); }},
      {"MetricsLog", [&] { MetricsLog log(fifo, 10); }},
  };
  for (const auto& [name, read] : readers)
    EXPECT_EQ(error_of(read), fifo + ": is a FIFO, socket or device, not a file") << name;
  EXPECT_TRUE(contains(error_of([] { read_file("/dev/zero"); }), "/dev/zero: is a FIFO, socket or device"));
}

/// A file with a hole of a terabyte is refused by its size, before anything of it is read.
TEST(Files, AFileThatIsTooLargeIsNotRead) {
  const Folder folder;
  make_file(folder / "x", "");
  std::filesystem::resize_file(folder / "x", std::uintmax_t{1} << 40);
  EXPECT_EQ(error_of([&] { read_file(folder / "x", 1000); }), folder / "x: is larger than 1000 bytes");
  EXPECT_TRUE(contains(error_of([&] { read_file(folder / "x"); }), "x: is larger than 17179869184 bytes"));
}

/// A header of a few megabytes took minutes when each name was compared with all before it.
TEST(Files, ManyTensorsAreReadAtOnce) {
  std::string header = "{";
  for (int i = 0; i < 200'000; ++i)
    header += (i ? ",\"t" : "\"t") + std::to_string(i) + R"(":{"dtype":"F32","shape":[0],"data_offsets":[0,0]})";
  header += "}";
  const std::uint64_t length = header.size();
  const Clock::time_point before = Clock::now();
  const std::string bytes = std::string(reinterpret_cast<const char*>(&length), sizeof length) + header;
  EXPECT_EQ(Safetensors::parse(bytes, "x").tensors.size(), 200'000u);
  EXPECT_LT(Clock::now() - before, std::chrono::seconds(10) * kSlowness);
}

}  // namespace
}  // namespace citylearn::testing
