// SPDX-License-Identifier: Apache-2.0
#include "env_service/traversal/sight.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

#include "core/util/random.h"
#include "env_service/dataset_io/selection.h"
#include "env_service/matching/monotone_path.h"
#include "tests/paths.h"
#include "tests/support/env/env.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr int kElsewhere = 10000;  // places from here on are in another street

/// A recording of places, each of which looks like no other.
Traversal drive(const std::string& name, const std::vector<int>& places) {
  Traversal traversal = small_traversal(static_cast<int>(places.size()));
  traversal.name = name;
  traversal.dimension = 16;
  traversal.features.clear();
  for (const int place : places) {
    Random random(static_cast<std::uint64_t>(place));
    for (int i = 0; i < traversal.dimension; ++i) traversal.features.push_back(static_cast<float>(random.uniform()));
  }
  return traversal;
}

std::vector<int> from_to(int first, int end, int step = 1) {
  std::vector<int> result;
  for (int i = first; i < end; i += step) result.push_back(i);
  return result;
}

/// Double speed from place 10, a stop of 12 frames at 60, half speed from there, 30 frames of another street instead of
/// places 90 to 99, then as fast as summer from 100 to 179.
std::vector<int> winter_places() {
  std::vector<int> places = from_to(10, 60, 2);
  places.insert(places.end(), 12, 60);
  for (int i = 0; i < 60; ++i) places.push_back(60 + i / 2);
  for (int i = 0; i < 30; ++i) places.push_back(kElsewhere + i);
  for (int i = 100; i < 180; ++i) places.push_back(i);
  return places;
}

TEST(BestMonotonePath, TakesStepsAlongOneAndGapsWhereTheyPay) {
  const std::vector<std::pair<int, int>> first{{0, 0}, {1, 1}, {1, 2}, {2, 3}}, second{{6, 8}, {7, 9}, {8, 10}};
  const RowScores scores = [&](int row, int begin, int end, float* to) {
    for (int column = begin; column < end; ++column) {
      const std::pair cell(row, column);
      *to++ =
          std::count(first.begin(), first.end(), cell) + std::count(second.begin(), second.end(), cell) > 0 ? 1 : -1;
    }
  };
  const Band all{std::vector<int>(9, 0), std::vector<int>(9, 11)};
  // 2 + 2 + (1 - .5) + 2 = 6.5 for the first part, 6 for the second.
  const MonotonePath with_gap = best_monotone_path(all, scores, {.threshold = 0, .gap = 3, .turn = 0.5F});
  EXPECT_FLOAT_EQ(with_gap.score, 6.5F - 3 + 6);
  std::vector<std::pair<int, int>> both = first;
  both.insert(both.end(), second.begin(), second.end());
  EXPECT_EQ(with_gap.pairs, both);
  const MonotonePath without = best_monotone_path(all, scores, {.threshold = 0, .gap = 7, .turn = 0.5F});
  EXPECT_FLOAT_EQ(without.score, 6.5F);
  EXPECT_EQ(without.pairs, first);
  EXPECT_TRUE(best_monotone_path(all, scores, {.threshold = 1}).pairs.empty());  // nothing is worth a place
}

// From block to block it goes down first: through (3, 2) to (3, 3).
TEST(BandAbout, LeavesTwoBlocksOnEitherSide) {
  MonotonePath diagonal;
  for (int i = 0; i < 10; ++i) diagonal.pairs.emplace_back(i, i);
  const Band band = band_about(diagonal, 10, 100, 97);
  EXPECT_EQ(std::pair(band.begin[0], band.end[0]), std::pair(0, 50));  // two blocks down, and two across from there
  EXPECT_EQ(std::pair(band.begin[69], band.end[69]), std::pair(10, 97));
  EXPECT_EQ(std::pair(band.begin[99], band.end[99]), std::pair(40, 97));
}

TEST(AlignBySight, FollowsSpeedsStopsAndDetours) {
  const Traversal summer = drive("summer", from_to(0, 200)), winter = drive("winter", winter_places());
  const SightAlignment alignment = align_by_sight(summer, from_to(0, 200), winter);
  EXPECT_EQ(alignment.summary,
            "winter: 177 of 207 frames show places of summer, median speed 1.0 times; frames 97-126 have no "
            "counterpart; it lacks frames 0-9, 90-99, 180-199 of summer, where no task begins or ends");
  EXPECT_TRUE(alignment.elsewhere);
  const std::vector<int> places = winter_places();
  for (int place = 0; place < 200; ++place) {
    const bool lacking = place < 10 || (place >= 90 && place < 100) || place >= 180;
    ASSERT_EQ(alignment.unmatched[static_cast<std::size_t>(place)], lacking) << place;
    const int shown = places[static_cast<std::size_t>(alignment.found[static_cast<std::size_t>(place)])];
    if (!lacking) {
      EXPECT_LE(std::abs(shown - place), place < 60 ? 1 : 0) << place;  // each second one is not there
    }
  }
}

TEST(AlignBySight, LooksAtThePartAskedFor) {
  const Traversal summer = drive("summer", from_to(0, 1000)), winter = drive("winter", from_to(300, 700));
  const SightAlignment alignment = align_by_sight(summer, from_to(400, 500, 5), winter);
  EXPECT_EQ(alignment.found, from_to(100, 200, 5));
  EXPECT_TRUE(alignment.unmatched.empty());
  EXPECT_TRUE(alignment.summary.starts_with("winter: 224 of 400 frames show places of summer's frames 336-559, "))
      << alignment.summary;
}

// As snow or lamps do: each 100 frames have a look of their own that is stronger than what tells places apart.
TEST(AlignBySight, SeesPlacesThroughTheLookOfAScene) {
  std::vector<int> places = from_to(0, 250);
  places.insert(places.end(), 300, 250);  // a stop that is longer than a scene
  for (int i = 251; i < 400; ++i) places.push_back(i);
  const Traversal summer = drive("summer", from_to(0, 400));
  Traversal winter = drive("winter", places);
  std::vector<int> scenes;
  for (const int place : places) scenes.push_back(kElsewhere + place / 100);
  const Traversal look = drive("look", scenes),
                  noise = drive("noise", from_to(2 * kElsewhere, 2 * kElsewhere + winter.frames));
  for (std::size_t i = 0; i < winter.features.size(); ++i)
    winter.features[i] += 2 * look.features[i] + 0.1F * noise.features[i];
  const SightAlignment alignment = align_by_sight(summer, from_to(0, 400), winter);
  EXPECT_EQ(std::count(alignment.unmatched.begin(), alignment.unmatched.end(), true), 0) << alignment.summary;
  EXPECT_TRUE(alignment.summary.starts_with("winter: 699 of 699 frames show places of summer")) << alignment.summary;
  for (int place = 0; place < 400; ++place) {
    const int shown = places[static_cast<std::size_t>(alignment.found[static_cast<std::size_t>(place)])];
    EXPECT_LE(std::abs(shown - place), 1) << place;
  }
}

TEST(AlignBySight, GoesFromCoarseToFineInLongRecordings) {
  std::vector<int> places = from_to(500, 2500, 2);
  for (int i = 2500; i < 3500; ++i) places.insert(places.end(), 2, i);
  const Traversal summer = drive("summer", from_to(0, 4000)), winter = drive("winter", places);
  const SightAlignment alignment = align_by_sight(summer, from_to(0, 4000), winter);
  int far = 0, lacking = 0;
  for (int place = 0; place < 4000; ++place) {
    const auto i = static_cast<std::size_t>(place);
    lacking += alignment.unmatched[i];
    if (!alignment.unmatched[i]) far += std::abs(places[static_cast<std::size_t>(alignment.found[i])] - place) > 1;
  }
  EXPECT_EQ(far, 0);
  EXPECT_NEAR(lacking, 1000, 8);
}

TEST(AlignBySight, RefusesWhatDoesNotFit) {
  const Traversal summer = drive("summer", from_to(0, 100));
  EXPECT_EQ(
      error_of([&] { align_by_sight(summer, from_to(0, 100), drive("park", from_to(kElsewhere, kElsewhere + 90))); }),
      "--align-by sight: no order of the frames of park looks like those of summer (does it show another street, "
      "or the way back? Look at both, or align another way)");
  std::vector<int> back = from_to(0, 100);
  std::reverse(back.begin(), back.end());
  EXPECT_THROW(align_by_sight(summer, from_to(0, 100), drive("back", back)), Error);
  EXPECT_EQ(error_of([&] { align_by_sight(summer, from_to(0, 100), small_traversal(90)); }),
            "--align-by sight: one of summer and line has pictures or features that the other lacks (align recordings "
            "of one kind)");
  EXPECT_THROW(align_by_sight(drive("alike", std::vector<int>(100, 7)), from_to(0, 100), summer), Error);
}

/// Two days on foot, the second with the camera farther to the left: real pictures.
TEST(AlignBySight, FollowsAWalkOfAnotherDay) {
  const std::string days = real_data(CITYLEARN_SOURCE_DIR, "gardens-point");
  if (days.empty()) GTEST_SKIP() << "needs gardens-point of shared/data";
  const Folder folder;
  const auto record = [&](const std::string& name, const std::string& day, const std::vector<int>& places) {
    std::filesystem::create_directory(folder / name);
    for (std::size_t i = 0; i < places.size(); ++i) {
      char from[32];
      std::snprintf(from, sizeof from, "/Image%04d.png", places[i]);
      std::filesystem::create_symlink(days + "/" + day + from, folder / (name + "/" + std::to_string(i) + ".png"));
    }
  };
  std::vector<int> places = winter_places();  // of which the last 40, 140 to 179, are left to be the other street
  places.resize(places.size() - 40);
  for (int& place : places)
    if (place >= kElsewhere) place += 160 - kElsewhere;
  record("summer", "day_right", from_to(0, 150));
  record("winter", "day_left", places);
  const auto dataset = make_dataset("plain", folder.path());
  const Traversal winter = select(*dataset, "winter", {.align = "summer", .by = "sight"});
  const SightAlignment alignment = align_by_sight(dataset->load("summer"), from_to(0, 150), dataset->load("winter"));
  EXPECT_EQ(winter.unmatched, alignment.unmatched);
  std::vector<int> errors;
  int lacking = 0, found_lacking = 0;
  for (int place = 0; place < 150; ++place) {
    const auto i = static_cast<std::size_t>(place);
    EXPECT_EQ(winter.images->name(place), "winter/" + std::to_string(alignment.found[i]) + ".png");
    lacking += place < 10 || place >= 140;
    found_lacking += (place < 10 || place >= 140) && alignment.unmatched[i];
    if (!alignment.unmatched[i])
      errors.push_back(std::abs(places[static_cast<std::size_t>(alignment.found[i])] - place));
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LE(errors[errors.size() / 2], 1);
  EXPECT_LE(errors[errors.size() * 95 / 100], 3);
  EXPECT_GE(found_lacking, lacking * 3 / 4);
  EXPECT_GE(errors.size(), 115u);  // of 120 places that both show, and ten that a detour leaves out
}

}  // namespace
}  // namespace citylearn::testing
