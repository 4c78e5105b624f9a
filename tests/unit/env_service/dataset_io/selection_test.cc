// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/selection.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>
#include <numeric>

#include "tests/support/data/fake_images.h"
#include "tests/support/env/env.h"
#include "tests/support/log.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// Some of them are broken.
class FewImages : public FakeImages {
 public:
  FewImages(int frames, std::vector<int> bad) : FakeImages(frames), bad_(std::move(bad)) {}
  std::string fault(int frame) const override {
    return std::find(bad_.begin(), bad_.end(), frame) == bad_.end() ? "" : "broken";
  }

 private:
  std::vector<int> bad_;
};

class Fake : public Dataset {
 public:
  std::vector<std::string> names() override {
    std::vector<std::string> names;
    for (const auto& [name, traversal] : traversals) names.push_back(name);
    return names;
  }
  Traversal load(const std::string& name) override {
    if (!traversals.contains(name)) throw unknown_traversal(name, "fake", names());
    return traversals.at(name);
  }
  std::string condition(const std::string& name) override { return traversals.at(name).condition; }
  Correspondence correspondence() const override { return natural; }
  std::vector<std::pair<int, int>> matches(const std::string& a, const std::string& b) override {
    if (pairs.empty()) return Dataset::matches(a, b);
    asked = a + " " + b;
    return pairs;
  }

  Traversal& add(const std::string& name, int frames, double metres_a_frame) {
    Traversal traversal = small_traversal(frames);
    traversal.name = name;
    for (int i = 0; i < frames; ++i) {
      traversal.positions[static_cast<std::size_t>(i)] = static_cast<float>(i * metres_a_frame);
      traversal.times.push_back(i * 0.5);
    }
    return traversals[name] = traversal;
  }

  std::map<std::string, Traversal> traversals;
  std::vector<std::pair<int, int>> pairs;
  std::string asked;
  Correspondence natural = Correspondence::kIndex;
};

/// Which frames of the recording they were: small_traversal() shows them.
std::vector<int> shown(const Traversal& traversal) {
  std::vector<int> frames;
  for (int i = 0; i < traversal.frames; ++i) frames.push_back(static_cast<int>(traversal.feature(i)[0]));
  EXPECT_EQ(traversal.features.size(), static_cast<std::size_t>(traversal.frames * traversal.dimension));
  EXPECT_EQ(traversal.positions.size(), static_cast<std::size_t>(traversal.frames));
  return frames;
}

struct Select : ::testing::Test {
  std::string refusal(const std::string& name, const Selection& selection) {
    return error_of([&] { select(fake, name, selection); });
  }
  Fake fake;
};
using SelectBadFrames = Select;
using SelectAligned = Select;

TEST_F(Select, NothingLeavesEverything) {
  const Traversal& whole = fake.add("a", 10, 2);
  const Traversal same = select(fake, "a", {});
  EXPECT_EQ(same.hash(), whole.hash());
  EXPECT_EQ(same.times, whole.times);
  EXPECT_THROW(select(fake, "b", {}), Error);
}

TEST_F(Select, WhatACameraFurtherLeftOrRightWouldHaveSeen) {
  Traversal& a = fake.add("a", 10, 2);
  EXPECT_EQ(refusal("a-left", {}), "traversal 'a': has no pictures to move (leave -left and -right out)");
  a.images = std::make_shared<FewImages>(10, std::vector<int>{});
  EXPECT_TRUE(contains(refusal("b-left", {}), "no traversal 'b-left'"));
  fake.pairs = {{0, 0}, {2, 2}};  // by which it is not aligned to where it comes from
  const Traversal whole = select(fake, "a", {});
  const Log log;
  const Traversal left = select(fake, "a-left", {.end = 4, .align = "a"}), right = select(fake, "a-right", {});
  EXPECT_TRUE(
      log.has("'a-left' is 'a' as a camera further left would have seen it: there is no recording of this name"));
  EXPECT_EQ(left.name, "a-left");
  EXPECT_EQ(shown(left), (std::vector<int>{0, 1, 2, 3}));
  EXPECT_EQ(right.positions, a.positions);
  EXPECT_NE(left.images->fingerprint(0), whole.images->fingerprint(0));
  EXPECT_NE(left.images->fingerprint(0), right.images->fingerprint(0));
  fake.add("a-left", 5, 2);
  EXPECT_EQ(select(fake, "a-left", {}).frames, 5) << "a recording that is called so";
}

TEST_F(Select, FramesAndSteps) {
  Traversal& a = fake.add("a", 10, 2);
  a.latitude = a.longitude = a.times;
  const Traversal part = select(fake, "a", {.first = 2, .end = 9, .step = 3});
  EXPECT_EQ(shown(part), (std::vector<int>{2, 5, 8}));
  EXPECT_EQ(part.positions, (std::vector<float>{4, 10, 16}));
  EXPECT_EQ(part.times, (std::vector<double>{1, 2.5, 4}));
  EXPECT_EQ(part.latitude, part.times);
  EXPECT_EQ(part.longitude, part.times);
  EXPECT_EQ(part.name, "a");
  EXPECT_EQ(shown(select(fake, "a", {.first = 8})), (std::vector<int>{8, 9}));
  EXPECT_EQ(shown(select(fake, "a", {.end = 2})), (std::vector<int>{0, 1}));
  EXPECT_EQ(refusal("a", {.end = 11}), "--frames: beyond a, which has 10 frames");
  EXPECT_EQ(refusal("a", {.first = 10}), "--frames: beyond a, which has 10 frames");
  EXPECT_EQ(refusal("a", {.first = 3, .end = 3}), "--frames: no frame in it");
  EXPECT_EQ(refusal("a", {.first = 9}),
            "--frames, --metres or --step: of a only one frame is left, a route needs two (select more)");
}

TEST_F(Select, Metres) {
  Traversal& a = fake.add("a", 10, 2);
  EXPECT_EQ(shown(select(fake, "a", {.from = 3, .to = 10})), (std::vector<int>{2, 3, 4}));
  EXPECT_EQ(shown(select(fake, "a", {.step_metres = 5})), (std::vector<int>{0, 3, 6, 9}));
  EXPECT_EQ(shown(select(fake, "a", {.first = 1, .from = -5, .to = 15, .step_metres = 4})),
            (std::vector<int>{1, 3, 5, 7}));
  a.positions[0] = a.positions[3] = a.positions[6] = kNan;
  EXPECT_EQ(shown(select(fake, "a", {.from = 3, .to = 10})), (std::vector<int>{2, 3, 4}));
  EXPECT_EQ(shown(select(fake, "a", {.step_metres = 5})), (std::vector<int>{1, 4, 7}));
  EXPECT_EQ(refusal("a", {.step_metres = 0.04}), "--step-metres: must be 0.05 or more");
  EXPECT_EQ(refusal("a", {.step = 2, .step_metres = 1}),
            "--step-metres: cannot be together with --step (give one of them)");
  EXPECT_EQ(refusal("a", {.from = 100}),
            "--frames, --metres or --step: of a no frame is left, a route needs two (select more)");
  a.positions.assign(10, kNan);
  for (const Selection& selection : {Selection{.from = 1}, Selection{.step_metres = 1}})
    EXPECT_TRUE(contains(refusal("a", selection), "positions of a are not known"));
}

TEST_F(SelectBadFrames, RefusedByName) {
  Traversal& a = fake.add("a", 10, 2);
  a.images = std::make_shared<FewImages>(10, std::vector<int>{3, 4});
  EXPECT_EQ(refusal("a", {}),
            "f3: broken, and 1 more bad frames (replace the files, cut with --frames, or use their neighbours with "
            "--on-bad-frame skip)");
  // Bad frames that nobody asked for do no harm.
  const Traversal rest = select(fake, "a", {.first = 5});
  EXPECT_EQ(rest.images->name(0), "f5");
}

TEST_F(SelectBadFrames, TheNearestGoodOneStandsIn) {
  Traversal& a = fake.add("a", 10, 2);
  a.images = std::make_shared<FewImages>(10, std::vector<int>{0, 3, 4, 5, 9});
  const Traversal mended = select(fake, "a", {.skip_bad_frames = true});
  ASSERT_EQ(mended.frames, 10);
  ASSERT_EQ(mended.images->frames(), 10);
  const std::vector<std::string> expected{"f1", "f1", "f2", "f2", "f2", "f6", "f6", "f7", "f8", "f8"};
  for (int i = 0; i < 10; ++i) EXPECT_EQ(mended.images->name(i), expected[static_cast<std::size_t>(i)]) << i;
  EXPECT_EQ(mended.positions, a.positions);
  // A stand-in may lie outside of what was cut out.
  EXPECT_EQ(select(fake, "a", {.first = 3, .end = 5, .skip_bad_frames = true}).images->name(0), "f2");
  a.images = std::make_shared<FewImages>(2, std::vector<int>{0, 1});
  a.frames = 2;
  EXPECT_TRUE(contains(refusal("a", {.skip_bad_frames = true}), "no frame of the recording can be read"));
}

TEST_F(SelectAligned, ByIndex) {
  fake.add("a", 10, 2);
  fake.add("b", 8, 3);
  const Traversal b = select(fake, "b", {.first = 1, .end = 8, .step = 2, .align = "a"});
  EXPECT_EQ(shown(b), (std::vector<int>{1, 3, 5, 7}));
  EXPECT_EQ(b.positions, (std::vector<float>{3, 9, 15, 21}));  // its own metres
  EXPECT_EQ(
      refusal("b", {.align = "a"}),
      "--align-by index: frame 8 of a has no counterpart, b has 8 frames (cut with --frames, or align another way)");
  EXPECT_NE(refusal("a", {.align = "a"}), "");
  EXPECT_TRUE(contains(refusal("a", {.align = "c"}), "no traversal 'c'"));
  EXPECT_TRUE(contains(refusal("a", {.align = "b", .by = "luck"}), "unknown way 'luck'"));
}

TEST_F(SelectAligned, ByMatches) {
  fake.add("a", 10, 2);
  fake.add("b", 30, 1);
  EXPECT_TRUE(contains(refusal("b", {.align = "a", .by = "matches"}), "no match file"));
  fake.natural = Correspondence::kMatches;
  fake.pairs = {{7, 20}, {2, 5}, {4, 9}, {4, 10}};
  const Traversal b = select(fake, "b", {.first = 2, .end = 8, .align = "a"});
  EXPECT_EQ(fake.asked, "a b");
  EXPECT_EQ(shown(b), (std::vector<int>{5, 7, 9, 13, 16, 20}));
  EXPECT_EQ(refusal("b", {.align = "a"}),
            "--align-by matches: frame 0 of a has no match, they go from 2 to 7 (cut with --frames)");
  EXPECT_NE(refusal("b", {.first = 2, .end = 9, .align = "a"}), "");
  fake.pairs = {{0, 0}, {9, 30}};
  EXPECT_TRUE(contains(refusal("b", {.align = "a"}), "the match of frames 9 and 30 is beyond"));
}

TEST_F(SelectAligned, ByDistance) {
  fake.add("a", 10, 2);
  Traversal& b = fake.add("b", 40, 0.7);
  fake.natural = Correspondence::kDistance;
  const std::vector<int> expected{0, 3, 6, 9, 11, 14, 17, 20, 23, 26};  // round(i 2 / 0.7)
  EXPECT_EQ(shown(select(fake, "b", {.align = "a"})), expected);
  b.positions[3] = kNan;
  EXPECT_EQ(shown(select(fake, "b", {.align = "a"}))[1], 2);  // at 1.4 m; 2.8 m is farther
  EXPECT_EQ(refusal("a", {.align = "b", .tolerance = 1.5}),
            "--align-by distance: the position of frame 3 of b is not known (cut with --frames)");
  EXPECT_EQ(refusal("a", {.first = 4, .align = "b", .tolerance = 1.5}),
            "--align-by distance: frame 28 of b at 19.6 m is 1.6 m from the nearest frame of a (cut with --frames, or "
            "raise --align-within)");
}

/// A figure of eight: two circles of 50 m radius that meet in the middle, where the route passes three times.
void draw_eight(Traversal& traversal, double east = 0) {
  constexpr double kDegree = 6'371'008.8 * std::numbers::pi / 180;
  traversal.latitude.clear();
  traversal.longitude.clear();
  for (int i = 0; i < traversal.frames; ++i) {
    const double turn = 4 * std::numbers::pi * i / (traversal.frames - 1);
    const bool second = turn > 2 * std::numbers::pi;
    const double x = second ? 50 * std::cos(turn) - 50 : 50 - 50 * std::cos(turn);
    traversal.latitude.push_back(45 + 50 * std::sin(turn) / kDegree);
    traversal.longitude.push_back(7 + (x + east) / (kDegree * std::cos(45 * std::numbers::pi / 180)));
  }
}

TEST_F(SelectAligned, ByGpsFollowsARouteThatCrossesItself) {
  fake.natural = Correspondence::kGps;
  draw_eight(fake.add("a", 101, 1));
  draw_eight(fake.add("b", 401, 1),
             0.4);  // the receiver is off by 40 cm: at the crossing, the wrong pass may be nearer
  const std::vector<int> frames = shown(select(fake, "b", {.align = "a"}));
  ASSERT_EQ(frames.size(), 101u);
  for (int i = 0; i < 101; ++i) EXPECT_NEAR(frames[static_cast<std::size_t>(i)], 4 * i, 2) << i;
  EXPECT_TRUE(std::is_sorted(frames.begin(), frames.end()));
  EXPECT_TRUE(contains(refusal("b", {.align = "a", .tolerance = 0.1}), "no frame of b within 0.1 m"));
}

TEST_F(SelectAligned, ByGpsGoesBackWhenItMust) {
  draw_eight(fake.add("a", 101, 1));
  Traversal& b = fake.add("b", 401, 1);
  draw_eight(b);
  // b was begun in the middle: the first circle comes last.
  for (std::vector<double>* numbers : {&b.latitude, &b.longitude})
    std::rotate(numbers->begin(), numbers->begin() + 200, numbers->end());
  const std::vector<int> frames = shown(select(fake, "b", {.align = "a", .by = "gps", .tolerance = 5}));
  int returns = 0;
  for (std::size_t i = 1; i < frames.size(); ++i) returns += frames[i] < frames[i - 1];
  EXPECT_EQ(returns, 1);
  EXPECT_NEAR(frames[25], 300, 3);
  EXPECT_NEAR(frames[75], 100, 3);
}

/// Places of a straight road, 5 m apart.
void draw_road(Traversal& traversal, const std::vector<int>& places) {
  constexpr double kMetre = 180 / (6'371'008.8 * std::numbers::pi);
  traversal.latitude.clear();
  for (const int place : places) traversal.latitude.push_back(45 + 5 * place * kMetre);
  traversal.longitude.assign(places.size(), 7);
}

TEST_F(SelectAligned, ByGpsFollowsADriveTheOtherWay) {
  std::vector<int> there(40), back(40), both;
  std::iota(there.begin(), there.end(), 0);
  std::iota(back.rbegin(), back.rend(), 0);
  both = there;
  both.insert(both.end(), back.begin() + 1, back.end());
  struct Case {
    const char* what;
    std::vector<int> sibling, traversal, frames;
    const char* told;
  };
  const std::vector<int> begin(there.begin(), there.begin() + 9), end(begin.rbegin(), begin.rend());
  std::vector<int> all(79);
  std::iota(all.begin(), all.end(), 0);
  for (const Case& one : {Case{"back", there, back, back, "39 of 39 steps of a go the other way than those of b"},
                          Case{"a short way back", begin, end, end, "8 of 8 steps"},
                          Case{"there and back, there", both, there, both, "39 of 78 steps"},
                          Case{"there, there and back", there, both, there, ""},
                          Case{"back, there and back", back, both, {all.begin() + 39, all.end()}, ""},
                          Case{"both there and back", both, both, all, ""}}) {
    SCOPED_TRACE(one.what);
    Fake two;
    draw_road(two.add("a", static_cast<int>(one.sibling.size()), 5), one.sibling);
    draw_road(two.add("b", static_cast<int>(one.traversal.size()), 5), one.traversal);
    const Log log;
    EXPECT_EQ(shown(select(two, "b", {.align = "a", .by = "gps"})), one.frames);
    EXPECT_EQ(log.lines(), *one.told ? 1 : 0) << log.text();
    EXPECT_TRUE(log.has(one.told)) << log.text();
  }
}

TEST_F(SelectAligned, TellsThatPlacesAreApart) {
  std::vector<int> there(40), later(40), back(40);
  std::iota(there.begin(), there.end(), 0);
  std::iota(later.begin(), later.end(), 1);
  std::iota(back.rbegin(), back.rend(), 0);
  draw_road(fake.add("a", 40, 5), there);
  draw_road(fake.add("back", 40, 5), back);
  draw_road(fake.add("later", 40, 5), later);
  for (const std::string by : {"index", "distance"}) {
    const Log log;
    select(fake, "later", {.align = "a", .by = by});
    EXPECT_EQ(log.text(), "") << "5 m";
    select(fake, "back", {.align = "a", .by = by});
    EXPECT_EQ(log.lines(), 1);
    EXPECT_TRUE(log.has("frames of a and back that are taken for the same places are 105.0 m apart")) << log.text();
  }
  std::swap(fake.traversals["later"].latitude, fake.traversals["later"].longitude);
  const Log log;
  select(fake, "later", {.align = "a"});
  EXPECT_TRUE(log.has("columns exchanged")) << log.text();
}

TEST_F(SelectAligned, ByGpsNeedsPositions) {
  fake.add("a", 10, 2);
  draw_eight(fake.add("b", 10, 2));
  EXPECT_TRUE(contains(refusal("b", {.align = "a", .by = "gps"}), "of a are not known"));
  draw_eight(fake.traversals["a"]);
  fake.traversals["a"].latitude[4] = kNan;
  EXPECT_EQ(refusal("b", {.align = "a", .by = "gps"}),
            "--align-by gps: the position of frame 4 of a is not known (cut with --frames)");
}

TEST(Condition, ChoosesTheOneTraversal) {
  Fake fake;
  fake.add("a", 10, 2).condition = "night";
  fake.add("b", 10, 2).condition = "rain";
  fake.add("c", 10, 2).condition = "rain";
  Source source;
  source.traversal = "c";
  EXPECT_EQ(chosen_traversal(fake, source), "c");
  source.condition = "night";
  EXPECT_EQ(chosen_traversal(fake, source), "a");
  source.condition = "rain";
  EXPECT_EQ(error_of([&] { chosen_traversal(fake, source); }),
            "--condition: 2 traversals were recorded under 'rain' (name one with --traversal: b, c)");
  source.condition = "snow";
  EXPECT_EQ(error_of([&] { chosen_traversal(fake, source); }),
            "--condition: no traversal was recorded under 'snow' (there are: night, rain)");
}

}  // namespace
}  // namespace citylearn::testing
