// SPDX-License-Identifier: Apache-2.0
// What sections plan: which numbers of features are compared, imperfect worlds.
#include "tools/paper/sections/sections.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/processes/service.h"

namespace citylearn::paper {
namespace {

/// A section of the quick report, planned and computed in a folder of its own.
class SectionTest : public ::testing::Test {
 protected:
  explicit SectionTest(const std::string& name)
      : work_(folder_ / "work"),
        section_(*std::find_if(sections().begin(), sections().end(),
                               [&](const Section& section) { return section.name == name; })) {}

  Context context(World& world, World& drawn, double effort = 0.001) {
    return {
        .world = world, .drawn = drawn, .work = work_, .quick = true, .effort = effort, .seeds = {1, 2}, .agents = {}};
  }

  const testing::Folder folder_;
  Work work_;
  const Section& section_;
};

class DimensionsSection : public SectionTest {
 protected:
  DimensionsSection() : SectionTest("dimensions") {}

  static WorldOptions city(bool pictures) {
    WorldOptions options;
    options.source.parameters["synthetic"] = {
        {"frames", 130}, {"images", pictures ? 1.0 : 0.0}, {"width", 64}, {"height", 48}};
    if (pictures) options.encoder = "hog";
    return options;
  }
};

TEST_F(DimensionsSection, SaysWhichNumbersOfFeaturesCannotBeHad) {
  World features(city(false)), pictures(city(true));
  Context given = context(features, pictures);
  given.agents = {{"features", "features", {1}, 1}};
  const Json data = planned(section_, given);
  EXPECT_TRUE(data["substitute"]);
  EXPECT_EQ(data["encoder"], "hog");
  EXPECT_EQ(data["learned_from"], 130);
  EXPECT_EQ(data["missing"], Json({512, 2048, 4096})) << "130 frames have 129 components";
  ASSERT_EQ(data["points"].size(), 3u);
  EXPECT_EQ(data["points"][0][0]["features"], 64);
  EXPECT_EQ(data["points"][1][0]["features"], 128);
  EXPECT_EQ(data["points"][2][0]["features"], 129) << "the most that can be had is tried instead";
  // place_filter with two seeds and two controls each, and the paper's agent on the fewest and the most.
  EXPECT_EQ(work_.units(), 3 * (2 + 2) + 2);
  ASSERT_TRUE(work_.run());
  for (const Json& size : data["points"])
    for (const Json& policy : size)
      for (const Json& unit : policy["units"]) {
        const Json& outcome = work_.outcome(unit.get<int>());
        EXPECT_EQ((policy["learns"] ? outcome["trials"] : outcome).size(),
                  (policy["learns"] ? 2 : 1) * pictures.names().size())
            << "each condition, as it is and, of agents, shuffled";
      }
}

class ImperfectWorldSection : public SectionTest {
 protected:
  ImperfectWorldSection() : SectionTest("imperfect-world") {}

  /// Trials of a world's policy that learns nothing.
  Json trials(const Json& world, const std::string& label) const {
    for (const Json& policy : world)
      if (policy["label"] == label) return work_.outcome(policy["units"][0].get<int>());
    ADD_FAILURE() << "no " << label;
    return nullptr;
  }
  /// SPL on the traversal learned from.
  double spl(const Json& world, const std::string& label) const {
    return trials(world, label).at(0).at("spl").get<double>();
  }
};

TEST_F(ImperfectWorldSection, AgentsAndControlsMeetTheSameMishaps) {
  WorldOptions options;
  options.source.parameters["synthetic"] = {{"images", 0}, {"frames", 130}};
  World world(options);
  Context given = context(world, world, 0.01);
  given.effort = 0.05;
  const Json data = planned(section_, given);
  ASSERT_EQ(data["points"].size(), 5u);
  // Two seeds and three controls each, and a filter that is told where there is something to tell.
  EXPECT_EQ(work_.units(), 5 * (2 + 3) + 3);
  ASSERT_TRUE(work_.run());
  const Json &perfect = data["points"][0], &slipping = data["points"][1], &dropping = data["points"][2],
             &kidnapping = data["points"][3], &all = data["points"][4];
  EXPECT_EQ(perfect[0]["parameters"], Json::object());
  EXPECT_EQ(slipping[0]["parameters"], Json({{"slip", 0.1}}));
  EXPECT_EQ(dropping[0]["parameters"], Json::object());
  EXPECT_EQ(kidnapping[0]["parameters"], Json({{"kidnap", 3.0 / 128}}));
  EXPECT_EQ(all[0]["parameters"].size(), 2u);
  EXPECT_EQ(spl(perfect, "shortest_path"), 1);
  for (const Json* world_of : {&slipping, &kidnapping, &all}) {
    EXPECT_LT(spl(*world_of, "shortest_path"), 1) << *world_of;
    EXPECT_NE(trials(*world_of, "sequence_filter"), trials(*world_of, "sequence_filter, told")) << *world_of;
  }
  EXPECT_EQ(spl(dropping, "shortest_path"), 1) << "it does not look";
  EXPECT_EQ(trials(dropping, "blind"), trials(perfect, "blind"));
  EXPECT_NE(trials(dropping, "sequence_filter"), trials(perfect, "sequence_filter"));
  std::vector<Json> curves;
  for (const Json& one : data["points"])
    for (const Json& unit : one[0]["units"]) {
      const Json& training = work_.outcome(unit.get<int>());
      EXPECT_EQ(training["trials"].size(), 2 * data["traversals"].size());
      Json curve = training["curve"];
      curve.erase("seconds");
      // Drawn features are so clear that dropped frames alone mislead nobody.
      if (one != dropping) {
        EXPECT_EQ(std::count(curves.begin(), curves.end(), curve), 0) << "each world is another training";
      }
      curves.push_back(curve);
    }
}

}  // namespace
}  // namespace citylearn::paper
