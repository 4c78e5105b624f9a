// SPDX-License-Identifier: Apache-2.0
// docs/tutorials/write-a-dataset.md, followed to the letter, its promises kept.
#include "tests/support/text.h"
#include "tests/tutorial/tutorial.h"

namespace citylearn::testing {
namespace {

class DatasetTutorial : public Tutorial {
 protected:
  DatasetTutorial() : Tutorial("write-a-dataset") {}
};

TEST_F(DatasetTutorial, KeepsItsPromises) {
  ASSERT_NO_FATAL_FAILURE(follow(3));
  EXPECT_TRUE(contains(output_, "[       OK ] All/DatasetsOfFiles.KnowAFolderOfOtherThingsIsNotTheirs/photo_log"));
  EXPECT_TRUE(contains(output_, "wall: recognised as photo_log"));
  EXPECT_TRUE(contains(output_, "photo_log: 135 frames, 0 bad"));
  EXPECT_TRUE(contains(output_, "evening    evening        75      59    0.80"));
  EXPECT_TRUE(contains(output_, "morning    morning        60      59    1.00"));
  expect_promised_spl("morning", "evening", "in the morning and of");
}

TEST_F(DatasetTutorial, TheFolderForThisRepositoryIsRight) {
  expect_home("photo_log.cc", "env_service/datasets/", "plain.cc", "env_service/CMakeLists.txt",
              "GLOB_RECURSE sources");
}

}  // namespace
}  // namespace citylearn::testing
