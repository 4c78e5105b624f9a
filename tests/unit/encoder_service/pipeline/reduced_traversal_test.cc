// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/reduced_traversal.h"

#include <gtest/gtest.h>

#include <fstream>

#include "core/util/random.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Eigen::MatrixXf;

constexpr int kShort = 70, kNumbers = 12;
const FeatureStore::Key kReducedKey{"hog-1 bins=12", kNumbers, 11, kShort};
const ReductionOptions kToFour{.dimension = 4};

MatrixXf drawn_descriptors() {
  Random random{5};
  MatrixXf all(kNumbers, kShort);
  for (float& number : all.reshaped()) number = static_cast<float>(random.normal());
  return all;
}

/// A traversal with all of drawn_descriptors(), as a process of its own opens it.
struct Encoded {
  explicit Encoded(const std::string& folder, int bad = -1) : store(folder), work(folder, kReducedKey, division) {
    const MatrixXf all = drawn_descriptors();
    for (int frame = 0; frame < kShort; ++frame) frame == bad ? work.put_bad(frame) : work.put(frame, all.col(frame));
  }
  ReducedTraversal reduced(const std::string& path = "") { return reduce_traversal(work, {{}, kToFour, path}, store); }

  std::string store;
  BlockDivision division{1, kReducedKey.traversal, kShort};
  TraversalWork work;
};

/// Returns the file with this many numbers a frame.
std::string file_with(const Folder& folder, int numbers) {
  for (const std::string& path : paths_in(folder.path()))
    if (std::uint32_t found[4]; std::ifstream(path, std::ios::binary).read(reinterpret_cast<char*>(found), 16))
      if (path.ends_with(".features") && found[3] == static_cast<std::uint32_t>(numbers)) return path;
  return "";
}

/// Overwrites the numbers of the last frame.
void tear(const std::string& path) {
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(-4, std::ios::end).write("torn", 4);
}

TEST(ReducedTraversal, IsWhatTheReductionGivesOfAll) {
  const Folder folder;
  MatrixXf all = drawn_descriptors();
  const MatrixXf wanted = Reduction::learn(all, kToFour).apply(all);
  EXPECT_EQ(Encoded("").reduced().features, wanted);
  EXPECT_EQ(Encoded(folder.path()).reduced().features, wanted);
  EXPECT_EQ(Encoded(folder.path()).reduced().features, wanted) << "from the store";
  const auto half = std::make_shared<Reduction>(Reduction::learn(all, {.dimension = 2}));
  Encoded other(folder.path());
  EXPECT_EQ(reduce_traversal(other.work, {half, {}, ""}, folder.path()).features, half->apply(all))
      << "another reduction's are not taken for them";
  std::ofstream(file_with(folder, 4)) << "something else";
  EXPECT_EQ(Encoded(folder.path()).reduced().features, wanted) << "a file that is none costs time alone";
}

TEST(ReducedTraversal, StoredFeaturesNeedNoDescriptors) {
  const Folder folder;
  const std::string path = folder.path() + "/learned";
  const MatrixXf wanted = Encoded(folder.path()).reduced(path).features;
  tear(file_with(folder, kNumbers));
  BlockDivision division(1, kReducedKey.traversal, kShort);
  const TraversalWork again(folder.path(), kReducedKey, division);
  ASSERT_TRUE(again.complete());
  EXPECT_EQ(reduce_traversal(again, {{}, kToFour, path}, folder.path()).features, wanted);
  tear(file_with(folder, 4));
  const ReducedTraversal torn = reduce_traversal(again, {{}, kToFour, path}, folder.path());
  EXPECT_EQ(torn.lost, std::vector<int>{kShort - 1}) << "then they are needed";
  Encoded mended(folder.path());
  mended.work.lose({torn.lost.front(), torn.lost.front()});
  EXPECT_EQ(mended.work.done(), kShort - 1);
  mended.work.put(kShort - 1, drawn_descriptors().col(kShort - 1));
  EXPECT_EQ(mended.reduced(path).features, wanted);
  EXPECT_EQ(mended.reduced(path).features, wanted);
}

TEST(ReducedTraversal, ABadFrameHasItsNeighboursFeaturesAndNoneAreStored) {
  const Folder folder;
  MatrixXf all = drawn_descriptors();
  all.col(0) = all.col(1);
  EXPECT_EQ(Encoded(folder.path(), 0).reduced().features, Reduction::learn(all, kToFour).apply(all));
  EXPECT_EQ(file_with(folder, 4), "");
}

TEST(ReducedTraversal, RefusesTheReductionOfOtherDescriptors) {
  const auto other = std::make_shared<Reduction>(Reduction::learn(MatrixXf::Random(kNumbers + 1, 9), kToFour));
  Encoded encoded("");
  EXPECT_EQ(error_of([&] {
              reduce_traversal(encoded.work, {other, {}, ""}, "");
            }),
            "descriptors of 12 numbers, the reduction was learned on 13");
}

}  // namespace
}  // namespace citylearn::testing
