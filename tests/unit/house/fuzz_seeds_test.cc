// SPDX-License-Identifier: Apache-2.0
// What the fuzzers begin with, and images broken at random, through the fuzzers' own functions.
#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "core/wire/messages.h"
#include "encoder_service/encoding/encoder.h"
#include "tests/fuzz/messages.h"
#include "tests/fuzz/targets.h"
#include "tests/paths.h"
#include "tests/support/processes/service.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

const fs::path kSeeds = fs::path(CITYLEARN_SOURCE_DIR) / "tests/fuzz/seeds";

/// Seeds that a reader is right to refuse.
const std::set<std::string> kRefused = {
    "features_csv/extremes",
    "features_csv/gap",
    "features_csv/ragged",
    "features_csv/words",
    "feature_store/other-key",
    "text_table/empty",
    "picture/dicom-after-p6",
    "encoder_file/reduction-other",
    "dataset_folder/plain-loose-images",
    "dataset_folder/plain-conflict",
    "mcap_file/cut-short",
    "mcap_file/compressed",
    "web_request/frame",  // of a traversal that is not there, as the next one
    "web_request/map",
    "web_request/no-path",
    "web_request/no-utf8",
    "web_request/page",  // is no API call
};

TEST(FuzzSeeds, EachTargetTakesItsSeedsOrRefusesThem) {
  int replayed = 0;
  for (const fuzz::Target& target : fuzz::kTargets) {
    ASSERT_TRUE(fs::is_directory(kSeeds / target.name)) << target.name;
    for (const fs::directory_entry& seed : fs::directory_iterator(kSeeds / target.name)) {
      const std::string name = std::string(target.name) + "/" + seed.path().filename().string();
      SCOPED_TRACE(name);
      const std::string bytes = contents(seed.path());
      const bool taken = target.run(std::as_bytes(std::span(bytes)));
      EXPECT_EQ(taken, !kRefused.contains(name));
      ++replayed;
    }
  }
  EXPECT_GT(replayed, 40);
  for (const std::string& name : kRefused) EXPECT_TRUE(fs::exists(kSeeds / name)) << name;
}

TEST(FuzzSeeds, EachFolderOfSeedsHasItsTarget) {
  for (const fs::directory_entry& folder : fs::directory_iterator(kSeeds)) {
    bool known = false;
    for (const fuzz::Target& target : fuzz::kTargets) known |= target.name == folder.path().filename();
    EXPECT_TRUE(known) << folder.path();
  }
}

/// A few changes of the kinds that disks, networks and enemies make.
template <class Byte>
std::vector<Byte> broken(std::vector<Byte> file, std::mt19937& random) {
  const auto below = [&random](std::size_t end) { return static_cast<std::size_t>(random()) % end; };
  // Half of all changes go where the headers are.
  const auto place = [&] { return below(random() % 2 ? file.size() : std::min<std::size_t>(file.size(), 64)); };
  for (std::size_t changes = 1 + below(4); changes > 0 && file.size() > 1; --changes) {
    const std::size_t at = place();
    switch (below(6)) {
      case 0:
        file[at] = static_cast<Byte>(static_cast<unsigned>(file[at]) ^ 1u << below(8));
        break;
      case 1:
        file[at] = static_cast<Byte>(random());
        break;
      case 2:
        for (std::size_t i = at; i < std::min(file.size(), at + 4); ++i)
          file[i] = static_cast<Byte>(random() % 2 ? 0xFF : 0x00);
        break;
      case 3:
        file.resize(at + 1);
        break;
      case 4:
        file.erase(file.begin() + static_cast<std::ptrdiff_t>(at),
                   file.begin() + static_cast<std::ptrdiff_t>(std::min(file.size(), at + 1 + below(20))));
        break;
      default: {
        const std::vector<Byte> part(
            file.begin() + static_cast<std::ptrdiff_t>(at),
            file.begin() + static_cast<std::ptrdiff_t>(std::min(file.size(), at + 1 + below(40))));
        file.insert(file.begin() + static_cast<std::ptrdiff_t>(place()), part.begin(), part.end());
      }
    }
  }
  return file;
}

TEST(FuzzSeeds, EveryTypeOfMessageTakesItsSeedsAndFewBrokenOnes) {
  std::mt19937 random(1);
  EXPECT_EQ(fuzz::message_targets().size(), all_topics().size() + 6) << "and the kinds of objects";
  for (const auto& [type, target] : fuzz::message_targets()) {
    int refused = 0;
    for (const auto& [name, bytes] : target.seeds) {
      SCOPED_TRACE(type + "/" + name);
      EXPECT_TRUE(target.run(bytes));
      for (int round = 0; round < 300; ++round) refused += !target.run(broken(bytes, random));
    }
    EXPECT_GT(refused, type.starts_with("object") ? 50 : 300) << type;
  }
}

TEST(BrokenImages, AreTakenOrRefused) {
  std::vector<std::vector<unsigned char>> files;
  const std::pair<const char*, int> kinds[] = {{".png", 1}, {".png", 3}, {".jpg", 1}, {".jpg", 3}, {".ppm", 3},
                                               {".pgm", 1}, {".pbm", 1}, {".bmp", 1}, {".bmp", 3}};
  for (const auto& [suffix, channels] : kinds) {
    cv::Mat picture(24, 40, CV_8UC(channels));
    for (int y = 0; y < picture.rows; ++y)
      for (int x = 0; x < picture.cols * channels; ++x) picture.ptr(y)[x] = static_cast<unsigned char>(x * y + 3 * x);
    files.emplace_back();
    cv::imencode(suffix, picture, files.back());
  }
  std::mt19937 random(1);
  int taken = 0, refused = 0;
  for (int round = 0; round < 10000; ++round) {
    const std::vector<unsigned char> file = broken(files[static_cast<std::size_t>(round) % files.size()], random);
    ++(fuzz::picture(std::as_bytes(std::span(file))) ? taken : refused);
  }
  // Both ways are well trodden.
  EXPECT_GT(taken, 1000);
  EXPECT_GT(refused, 1000);
}

TEST(BrokenImages, ALargeImageOfFewBytesIsDecodedOrRefusedWithinItsLimit) {
  const std::string text = "P5 8192 8192 255\n";  // as many pixels as are allowed, and none of them there
  const auto decode = [](const std::string& file) { decode_picture(std::as_bytes(std::span(file)), "large.pgm"); };
  EXPECT_THROW(decode(text + "x"), Error);
  EXPECT_THROW(decode("P5 8193 8192 255\nx"), Error);
  EXPECT_THROW(decode("P5 1000000000 1 255\nx"), Error);
}

}  // namespace
}  // namespace citylearn::testing
