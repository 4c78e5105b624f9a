// SPDX-License-Identifier: Apache-2.0
// What the section on an imperfect world plans, and that policies meet the mishaps.
#include "tests/unit/tools/paper/sections/section_test.h"

namespace citylearn::paper {
namespace {

class ImperfectWorldSection : public SectionTest {
 protected:
  ImperfectWorldSection() : SectionTest("imperfect-world") {}

  /// Trials of a world's policy that learns nothing.
  Json trials(const Json& world, const std::string& label) const {
    for (const Json& control : world["controls"])
      if (control["label"] == label) return work_.outcome(control["unit"].get<int>());
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
  Context given = context(world, world);
  given.effort = 0.05;
  const Json data = section_.plan(given);
  ASSERT_EQ(data["worlds"].size(), 5u);
  // Two seeds and three controls each, and a filter that is told where there is something to tell.
  EXPECT_EQ(work_.units(), 5 * (2 + 3) + 3);
  ASSERT_TRUE(work_.run());
  const Json &perfect = data["worlds"][0], &slipping = data["worlds"][1], &dropping = data["worlds"][2],
             &kidnapping = data["worlds"][3], &all = data["worlds"][4];
  EXPECT_EQ(perfect["told"], Json::object());
  EXPECT_EQ(slipping["told"], Json({{"slip", 0.1}}));
  EXPECT_EQ(dropping["told"], Json::object());
  EXPECT_EQ(kidnapping["told"], Json({{"kidnap", 3.0 / 128}}));
  EXPECT_EQ(all["told"].size(), 2u);
  EXPECT_EQ(spl(perfect, "shortest_path"), 1);
  for (const Json* world_of : {&slipping, &kidnapping, &all}) {
    EXPECT_LT(spl(*world_of, "shortest_path"), 1) << *world_of;
    EXPECT_NE(trials(*world_of, "sequence_filter"), trials(*world_of, "sequence_filter, told")) << *world_of;
  }
  EXPECT_EQ(spl(dropping, "shortest_path"), 1) << "it does not look";
  EXPECT_EQ(trials(dropping, "blind"), trials(perfect, "blind"));
  EXPECT_NE(trials(dropping, "sequence_filter"), trials(perfect, "sequence_filter"));
  std::vector<Json> curves;
  for (const Json& one : data["worlds"])
    for (const Json& unit : one["agents"][0]["units"]) {
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
