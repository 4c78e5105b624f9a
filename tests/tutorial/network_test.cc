// SPDX-License-Identifier: Apache-2.0
// docs/tutorials/write-a-network.md, followed to the letter, its promises kept.
#include <nlohmann/json.hpp>

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
  const auto summary = nlohmann::json::parse(contents(workplace_ + "/runs/first/summary.json"));
  const double fall = promised("on summer and of");
  EXPECT_GE(summary["evaluate"]["summer"]["spl"].get<double>(), promised("an SPL of"));
  EXPECT_GE(summary["evaluate"]["fall"]["spl"].get<double>(), fall);
  EXPECT_LT(summary["controls"]["blind"]["fall"]["spl"].get<double>(), fall - 0.02);
  EXPECT_LT(summary["controls"]["shuffled"]["fall"]["spl"].get<double>(),
            summary["controls"]["blind"]["fall"]["spl"].get<double>());
}

TEST_F(NetworkTutorial, TheFolderForThisRepositoryIsRight) {
  expect_home("gru.cc", "policy_service/network/", "features.cc", "policy_service/CMakeLists.txt", "network/*.cc");
}

}  // namespace
}  // namespace citylearn::testing
