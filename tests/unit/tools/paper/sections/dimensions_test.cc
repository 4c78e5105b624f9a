// SPDX-License-Identifier: Apache-2.0
// Which numbers of features the section on them compares.
#include "tests/unit/tools/paper/sections/section_test.h"

namespace citylearn::paper {
namespace {

class DimensionsSection : public SectionTest {
 protected:
  DimensionsSection() : SectionTest("dimensions") {}

  static WorldOptions city(bool pictures) {
    WorldOptions options;
    options.source.parameters["synthetic"] = {
        {"frames", 130}, {"images", pictures ? 1.0 : 0.0}, {"width", 64}, {"height", 48}};
    if (pictures) options.encoders = {"hog"};
    return options;
  }
};

TEST_F(DimensionsSection, SaysWhichNumbersOfFeaturesCannotBeHad) {
  World features(city(false)), pictures(city(true));
  Context given = context(features, pictures);
  given.agents = {{"features", "features", {1}, 1}};
  const Json data = section_.plan(given);
  EXPECT_TRUE(data["substitute"]);
  EXPECT_EQ(data["encoder"], "hog");
  EXPECT_EQ(data["learned_from"], 130);
  EXPECT_EQ(data["missing"], Json({512, 2048, 4096})) << "130 frames have 129 components";
  ASSERT_EQ(data["sizes"].size(), 3u);
  EXPECT_EQ(data["sizes"][0]["features"], 64);
  EXPECT_EQ(data["sizes"][1]["features"], 128);
  EXPECT_EQ(data["sizes"][2]["features"], 129) << "the most that can be had is tried instead";
  // place_filter with two seeds and two controls each, and the paper's agent on the fewest and the most.
  EXPECT_EQ(work_.units(), 3 * (2 + 2) + 2);
  ASSERT_TRUE(work_.run());
  for (const Json& size : data["sizes"])
    for (const Json& agent : size["agents"])
      for (const Json& unit : agent["units"]) {
        const Json& trials = work_.outcome(unit.get<int>())["trials"];
        EXPECT_EQ(trials.size(), 2 * pictures.names().size()) << "each condition, as it is and shuffled";
      }
}

}  // namespace
}  // namespace citylearn::paper
