// SPDX-License-Identifier: Apache-2.0
// docs/tutorials/write-a-learner.md, followed to the letter, its promises kept.
#include "tests/support/text.h"
#include "tests/tutorial/tutorial.h"

namespace citylearn::testing {
namespace {

class LearnerTutorial : public Tutorial {
 protected:
  LearnerTutorial() : Tutorial("write-a-learner") {}
};

TEST_F(LearnerTutorial, KeepsItsPromises) {
  ASSERT_NO_FATAL_FAILURE(follow(2));
  EXPECT_TRUE(contains(output_, "[       OK ] LearnerContract.GoesOnFromWhatItSavedBitForBit/a2c"));
  for (const char* parameter : {"learning-rate", "gamma", "lambda", "entropy", "value-weight"})
    EXPECT_TRUE(contains(output_, "--a2c-" + std::string(parameter)));
  EXPECT_TRUE(contains(output_, "| fast"));
  auto summary = expect_promised_spl("summer", "fall", "on summer and of");
  EXPECT_LT(summary["controls"]["shuffled"]["fall"]["spl"].get<double>(),
            summary["controls"]["blind"]["fall"]["spl"].get<double>());
}

TEST_F(LearnerTutorial, TheFolderForThisRepositoryIsRight) {
  expect_home("a2c.cc", "policy_service/learning/learners/", "ppo.cc", "policy_service/CMakeLists.txt",
              "learning/*/*.cc");
}

}  // namespace
}  // namespace citylearn::testing
