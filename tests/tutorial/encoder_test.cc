// SPDX-License-Identifier: Apache-2.0
// docs/tutorials/write-an-encoder.md, followed to the letter, its promises kept.
#include <nlohmann/json.hpp>

#include "tests/support/text.h"
#include "tests/tutorial/tutorial.h"

namespace citylearn::testing {
namespace {

class EncoderTutorial : public Tutorial {
 protected:
  EncoderTutorial() : Tutorial("write-an-encoder") {}

  /// Recall@1 in a run of vpr.
  double recall(const std::string& run, const std::string& encoder, const std::string& query) const {
    const auto results = nlohmann::json::parse(contents(workplace_ + "/runs/" + run + "/results.json"));
    for (const auto& row : results.at("rows"))
      if (row.at("encoder") == encoder && row.at("query") == query) return row.at("recall_1").get<double>();
    ADD_FAILURE() << "no row for " << encoder << " and " << query;
    return 0;
  }
};

TEST_F(EncoderTutorial, KeepsItsPromises) {
  ASSERT_NO_FATAL_FAILURE(follow(2));
  EXPECT_TRUE(contains(output_, "[       OK ] Encoders/EncoderContract.AnyPictureGivesFiniteNumbers/patch_means"));
  for (const char* parameter : {"across", "down"})
    EXPECT_TRUE(contains(output_, "--patch_means-" + std::string(parameter)));
  EXPECT_GE(recall("coarse", "patch_means", "fall"), promised("it recognises"));
  EXPECT_GE(recall("coarse", "patch_means", "winter"), promised("in fall and"));
  EXPECT_GE(recall("fine", "patch_means", "winter"), promised("patches recognise"));
  EXPECT_GE(recall("coarse", "hog_vlad", "winter"), promised("patches recognise"));
  expect_promised_spl("summer", "fall", "on summer and of");
}

TEST_F(EncoderTutorial, TheFolderForThisRepositoryIsRight) {
  expect_home("patch_means.cc", "encoder_service/encoders/", "raw84.cc", "encoder_service/CMakeLists.txt",
              "GLOB_RECURSE sources");
}

}  // namespace
}  // namespace citylearn::testing
