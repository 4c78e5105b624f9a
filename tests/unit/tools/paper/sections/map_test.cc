// SPDX-License-Identifier: Apache-2.0
// What the section on a map plans, on drawn and on recorded maps.
#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include <filesystem>
#include <fstream>

#include "core/util/random.h"
#include "tests/unit/tools/paper/looped_recording.h"
#include "tests/unit/tools/paper/sections/section_test.h"

namespace citylearn::paper {
namespace {

class MapSection : public SectionTest {
 protected:
  MapSection() : SectionTest("map") {}
  static WorldOptions city() {
    WorldOptions options;
    options.source.parameters["synthetic"] = {{"images", 0}, {"frames", 130}};
    return options;
  }
};

TEST_F(MapSection, PlansPoliciesWithAndWithoutJunctionsOnADrawnMap) {
  World world(city());
  const Json data = section_.plan(context(world, world));
  EXPECT_EQ(work_.units(), 2 * (2 + 1 + 2) + 1);
  EXPECT_TRUE(data["drawn"]);
  EXPECT_EQ(data["layout"]["junctions"].size(), 7u);
  EXPECT_EQ(data["layout"]["east"].size(), 128u);
  EXPECT_EQ(data["traversals"].size(), 3u);
  ASSERT_EQ(data["policies"].size(), 9u);
  ASSERT_TRUE(work_.run());
  for (const Json& policy : data["policies"])
    for (const Json& unit : policy["units"]) EXPECT_EQ(work_.outcome(unit.get<int>())["trials"].size(), 3u) << policy;
}

TEST_F(MapSection, TakesRecordingsThatCrossThemselves) {
  const std::string data = folder_ / "data";
  std::filesystem::create_directories(data);
  const Traversal traversal = looped_recording();
  Random random{5};
  for (const std::string name : {"day", "night"}) {
    std::ofstream features(data + "/" + name + ".csv"), poses(data + "/" + name + ".poses.csv");
    poses << "frame,lat,lon\n";
    for (int i = 0; i < traversal.frames; ++i) {
      for (int k = 0; k < 8; ++k) features << random.normal() << (k < 7 ? "," : "\n");
      const auto at = static_cast<std::size_t>(i);
      if (std::isfinite(traversal.latitude[at]))
        poses << i << fmt::format(",{:.6f},{:.6f}\n", traversal.latitude[at], traversal.longitude[at]);
    }
  }
  WorldOptions options;
  options.source.dataset = "plain";
  options.source.folder = data;
  options.source.traversal = "day";
  options.source.selection.by = "index";  // night's features are no help in finding places, nor is a gap
  World world(options), drawn(city());
  const Json planned = section_.plan(context(world, drawn));
  EXPECT_FALSE(planned["drawn"]);
  EXPECT_FALSE(planned["recordings"]["drawn"]);
  EXPECT_EQ(planned["layout"]["junctions"].size(), 1u);
}

}  // namespace
}  // namespace citylearn::paper
