// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/checkpoint/training_data.h"

#include <gtest/gtest.h>

#include "core/util/error.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

const TrainingData kData{{{"summer", 0xAB, 64, "hog-1 | 64 running 0.2 of 00000000000000ab", "plain", 128},
                          {"my_fall", 0xCD, 64, "hog-1 | 64 running 0.2 of 00000000000000ab", "plain", 128}},
                         {{"data", "/home/me/my drives"}, {"frames", "0:128"}}};

TEST(TrainingData, IsReadAsItWasWritten) {
  const TrainingData read = TrainingData::parse(kData.text(), "here");
  EXPECT_EQ(read.names(), (std::vector<std::string>{"summer", "my_fall"}));
  EXPECT_EQ(read.text(), kData.text());
  EXPECT_EQ(read.source, kData.source);
  for (const TraversalContents& one : kData.traversals) EXPECT_EQ(read.misfit(one), "");
  EXPECT_EQ(TrainingData::parse("", "here").text(), "");
}

TEST(TrainingData, ReadsAManifestAndRefusesWhatIsNone) {
  const TrainingData old = TrainingData::parse(
      R"({"train": "a, b", "agent": "features", "traversals": {"a": {"hash": "00ff"}, "c": {}}})", "here");
  ASSERT_EQ(old.names(), std::vector<std::string>{"a"});
  EXPECT_EQ(old.traversals[0].hash, 255u);
  for (const char* text : {"[]", "{", "7", R"({"train": 1})", R"({"train": "a", "traversals": {"a": 2}})"})
    EXPECT_TRUE(contains(error_of([&] { TrainingData::parse(text, "manifest.json"); }), "manifest.json")) << text;
}

TEST(TrainingData, NamesWhatDoesNotFit) {
  TraversalContents other = kData.traversals[0];
  other.hash = 0xEE;
  other.frames = 200;
  EXPECT_EQ(kData.misfit(other),
            "has other contents (200 frames, hash 00000000000000ee) than the training (128 frames, hash "
            "00000000000000ab)");
  other.traversal = "winter";  // may be any, seen in the same way
  EXPECT_EQ(kData.misfit(other), "");
  EXPECT_EQ(TrainingData().misfit(other), "") << "nothing is known";
  other.encoder = "hog-1 | 64 running 0.2 of 00000000000000ee";
  EXPECT_EQ(kData.misfit(other),
            "has features of encoder 'hog-1 | 64 running 0.2 of 00000000000000ee', the training has those of "
            "'hog-1 | 64 running 0.2 of 00000000000000ab'");
  other.encoder.reset();
  EXPECT_EQ(kData.misfit(other), "");
  other.feature_dimension = 8;
  EXPECT_EQ(kData.misfit(other), "has 8 features a frame, the training has 64");
  EXPECT_EQ(kData.remedy("summer"),
            "take the data and the encoder of the training: --data /home/me/my drives --frames 0:128");
}

}  // namespace
}  // namespace citylearn::testing
