// SPDX-License-Identifier: Apache-2.0
// docs/tutorials/write-a-network.md, followed to the letter, its promises kept.
#include "tests/support/text.h"
#include "tests/tutorial/tutorial.h"

namespace citylearn::testing {
namespace {

class NetworkTutorial : public Tutorial {
 protected:
  NetworkTutorial() : Tutorial("write-a-network") {}
};

TEST_F(NetworkTutorial, KeepsItsPromises) {
  ASSERT_NO_FATAL_FAILURE(follow(2));
  EXPECT_TRUE(contains(output_, "[       OK ] All/Networks.DifferentiateWhatTheyCompute/gru"));
  for (const char* parameter : {"hidden", "cells"}) EXPECT_TRUE(contains(output_, "--gru-" + std::string(parameter)));
  auto summary = expect_promised_spl("summer", "fall", "on summer and of");
  EXPECT_LT(summary["controls"]["shuffled"]["fall"]["spl"].get<double>(),
            summary["controls"]["blind"]["fall"]["spl"].get<double>());
}

TEST_F(NetworkTutorial, TheFolderForThisRepositoryIsRight) {
  expect_home("gru.cc", "policy_service/network/agents/", "features.cc", "policy_service/CMakeLists.txt",
              "network/agents/*.cc");
}

}  // namespace
}  // namespace citylearn::testing
