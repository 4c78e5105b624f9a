// SPDX-License-Identifier: Apache-2.0
// A long recording of pictures costs next to no memory.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "env_service/dataset_io/selection.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/processes/service.h"

namespace citylearn::testing {
namespace {

/// Memory of this process in MiB.
double resident() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;)
    if (word == "VmRSS:") {
      double kibibytes = 0;
      status >> kibibytes;
      return kibibytes / 1024;
    }
  return 0;
}

#if defined(__SANITIZE_ADDRESS__)
constexpr double kMaxGrowth = 400;  // MiB: of what is freed it holds 256 back, to find who still uses it
#else
constexpr double kMaxGrowth = 60;
#endif

TEST(Memory, TenThousandPictures) {
  const Folder folder;
  // A picture of noise: as large as a camera's.
  cv::Mat noise(180, 320, CV_8UC3);
  cv::randu(noise, 0, 255);
  const std::string original = folder / "original.png";
  ASSERT_TRUE(cv::imwrite(original, noise));
  std::filesystem::create_directory(folder / "drive");
  for (int i = 0; i < 10'000; ++i)
    std::filesystem::create_hard_link(original,
                                      folder / ("drive/frame-with-a-rather-long-name-" + std::to_string(i) + ".png"));
  std::filesystem::remove(original);
  const auto dataset = make_dataset("plain", folder.path());
  const double before = resident();
  const Traversal traversal = select(*dataset, "drive", {.first = 1});
  ASSERT_EQ(traversal.frames, 9'999);
  EXPECT_NE(traversal.hash(), 0u);
  Bytes bytes;
  std::size_t sum = 0;
  for (int frame = 0; frame < traversal.frames; ++frame) {
    traversal.images->read(frame, bytes);
    sum += bytes.size();
  }
  const double growth = resident() - before;
  RecordProperty("MiB", std::to_string(growth));
  EXPECT_GT(sum, std::size_t{1} << 30);
  ASSERT_GT(before, 0);
  EXPECT_LT(growth, kMaxGrowth);
  std::cout << "grown by " << growth << " MiB over " << sum / (1 << 20) << " MiB of pictures\n";
}

}  // namespace
}  // namespace citylearn::testing
