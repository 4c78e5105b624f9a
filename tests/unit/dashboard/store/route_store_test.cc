// SPDX-License-Identifier: Apache-2.0
// Maps and pictures in the store: what runs show, each once, within budgets, and gone with the last run.
#include "dashboard/store/route_store.h"

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cmath>
#include <csignal>

#include "dashboard/store/database.h"
#include "dashboard/store/store_reader.h"
#include "tests/support/files.h"
#include "tests/support/records/records.h"

namespace citylearn::testing {
namespace {

constexpr std::uint64_t kSummer = 0xFEDCBA9876543210,
                        kWinter = 0x0123456789ABCDEF;  // one of them is negative in SQLite

PictureFile picture(std::size_t bytes, char content = 'x') { return {"image/jpeg", std::string(bytes, content)}; }

RouteMap map_of(std::uint32_t frames) {
  RouteMap map;
  map.frames = frames;
  for (std::uint32_t i = 0; i < frames; ++i) {
    map.position.push_back(i == 3 ? std::nanf("") : 2.5f * static_cast<float>(i));
    map.latitude.push_back(-27 + 1e-4 * i);
    map.longitude.push_back(153);
  }
  return map;
}

TraversalRow traversal(std::uint64_t hash = kSummer, std::uint64_t frames = 160) {
  TraversalRow row;
  row.environment = "env-summer";
  row.hash = hash;
  row.frames = frames;
  row.images = true;
  return row;
}

class RouteStoreTest : public ::testing::Test {
 protected:
  /// Records a run that begins, and an episode of it on a traversal.
  std::string begin_run(std::uint64_t job, std::uint64_t hash = kSummer, const std::string& manifest = "") {
    msg::RunInfo info = run_info(0, 500 + job, job, 1, kJob + job);
    if (!manifest.empty()) info.manifest(std::vector<std::uint8_t>(manifest.begin(), manifest.end()));
    info.ended() = true;
    store_.record(info);
    play(job, hash);
    return run_id(info);
  }
  void play(std::uint64_t job, std::uint64_t hash) {
    const std::string environment = "env-" + std::to_string(hash % 1000);
    msg::TraversalInfo hosted = traversal_info(environment);
    hosted.hash(hash);
    store_.record(std::vector{episode(++episodes_, environment, 7, kJob + job)});
    store_.describe(hosted);
  }
  /// Keeps pictures of `bytes` bytes until nothing is missing, or none is taken. Returns how many were kept.
  std::size_t fill(RouteStore& routes, const TraversalRow& row, std::size_t bytes) {
    std::size_t kept = 0;
    for (;;) {
      const auto gaps = routes.gaps(row);
      if (gaps.places.empty() || kept > 1000) return kept;
      const auto& place = gaps.places.front();
      std::string content = std::to_string(row.hash) + " " + std::to_string(place.frame);
      content.resize(bytes);
      if (!routes.keep(row.hash, place, {"image/jpeg", content})) return kept;
      ++kept;
    }
  }
  std::int64_t number(const std::string& sql) const { return open_database(store_.path()).execAndGet(sql).getInt64(); }

  Folder folder_;
  Store store_{{folder_ / "dashboard.sqlite", 0}};
  RouteStore routes_{store_};
  std::uint64_t episodes_ = 0;
};

TEST(SpreadFrames, AreEvenAlsoWhenTheyAreCutShort) {
  EXPECT_EQ(spread_frames(7, 7, 128), std::vector<std::uint32_t>{7});
  EXPECT_EQ(spread_frames(0, 4, 128), (std::vector<std::uint32_t>{0, 4, 2, 1, 3}));
  const auto all = spread_frames(1000, 35'999, 128);
  ASSERT_EQ(all.size(), 128u);
  for (const std::size_t count : {8u, 16u, 64u, 128u}) {
    std::vector<std::uint32_t> some(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(count));
    std::sort(some.begin(), some.end());
    EXPECT_EQ(some.front(), 1000u);
    const double even = 35'000.0 / static_cast<double>(count);
    for (std::size_t i = 1; i < count; ++i) EXPECT_NEAR(some[i] - some[i - 1], even, 0.02 * even) << count << " " << i;
    EXPECT_GT(some.back(), 35'999 - 1.02 * even);
  }
  EXPECT_EQ(std::set(all.begin(), all.end()).size(), 128u);
}

TEST_F(RouteStoreTest, KeepsWhatARunShowsAndNothingElse) {
  EXPECT_FALSE(routes_.keep(kSummer, map_of(160)));
  EXPECT_FALSE(routes_.gaps(traversal()).map) << "no run shows it";
  begin_run(1);
  const RouteStore::Gaps gaps = routes_.gaps(traversal());
  EXPECT_TRUE(gaps.map);
  ASSERT_EQ(gaps.places.size(), 128u) << "the manifest says 128 frames, of 160";
  EXPECT_EQ(gaps.places[1].frame, 64u);
  ASSERT_TRUE(routes_.keep(kSummer, map_of(160)));
  ASSERT_TRUE(routes_.keep(kSummer, gaps.places[1], picture(1000)));
  EXPECT_FALSE(routes_.keep(kWinter, gaps.places[1], picture(1000)));
  const RouteStore::Gaps rest = routes_.gaps(traversal());
  EXPECT_FALSE(rest.map);
  EXPECT_EQ(rest.places.size(), 127u);

  StoreReader reader(store_.path());
  const auto map = reader.map(kSummer);
  ASSERT_TRUE(map);
  EXPECT_EQ(map->frames, 160u);
  ASSERT_EQ(map->position.size(), 160u);
  EXPECT_TRUE(std::isnan(map->position[3]));
  EXPECT_EQ(map->position[159], 2.5f * 159);
  EXPECT_EQ(map->latitude, map_of(160).latitude);
  EXPECT_EQ(map->longitude.size(), 160u);
  EXPECT_FALSE(reader.map(kWinter));
  const auto found = reader.picture(kSummer, 64);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->picture.type, "image/jpeg");
  EXPECT_EQ(found->picture.bytes, std::string(1000, 'x'));
}

TEST_F(RouteStoreTest, FindsTheNearestPicture) {
  begin_run(1);
  const auto gaps = routes_.gaps(traversal());
  for (const std::uint32_t frame : {10u, 20u, 100u})
    ASSERT_TRUE(routes_.keep(kSummer, {gaps.places[0].part, frame}, picture(frame)));
  StoreReader reader(store_.path());
  for (const auto& [asked, nearest] :
       {std::pair(0u, 10u), {10u, 10u}, {14u, 10u}, {16u, 20u}, {61u, 100u}, {5000u, 100u}}) {
    const auto found = reader.picture(kSummer, asked);
    ASSERT_TRUE(found) << asked;
    EXPECT_EQ(found->frame, nearest) << asked;
    EXPECT_EQ(found->picture.bytes.size(), nearest);
  }
  EXPECT_FALSE(reader.picture(kWinter, 10));
}

TEST_F(RouteStoreTest, StoresOnceWhatManyRunsShowAndRemovesItWithTheLast) {
  std::vector<std::string> runs;
  for (std::uint64_t job = 1; job <= 3; ++job) runs.push_back(begin_run(job));
  play(3, kWinter);
  const auto gaps = routes_.gaps(traversal());
  ASSERT_TRUE(routes_.keep(kSummer, map_of(160)));
  ASSERT_TRUE(routes_.keep(kWinter, map_of(160)));
  ASSERT_TRUE(routes_.keep(kSummer, gaps.places[0], picture(5000)));
  ASSERT_TRUE(routes_.keep(kSummer, gaps.places[1], picture(5000))) << "a place that looks the same";
  ASSERT_TRUE(routes_.keep(kWinter, gaps.places[0], picture(5000)));
  ASSERT_TRUE(routes_.keep(kWinter, gaps.places[1], picture(5000, 'y')));
  EXPECT_EQ(number("SELECT COUNT(*) FROM pictures"), 2);
  EXPECT_EQ(number("SELECT COUNT(*) FROM places"), 4);

  ASSERT_EQ(store_.remove(runs[2]), Store::Removal::kDone);
  EXPECT_EQ(number("SELECT COUNT(*) FROM maps"), 1) << "nobody else shows winter";
  EXPECT_EQ(number("SELECT COUNT(*) FROM pictures"), 1);
  EXPECT_EQ(number("SELECT COUNT(*) FROM places"), 2);
  ASSERT_EQ(store_.remove(runs[0]), Store::Removal::kDone);
  EXPECT_EQ(number("SELECT COUNT(*) FROM places"), 2);
  ASSERT_EQ(store_.remove(runs[1]), Store::Removal::kDone);
  for (const std::string table : {"maps", "pictures", "places"})
    EXPECT_EQ(number("SELECT COUNT(*) FROM " + table), 0) << table;
}

TEST_F(RouteStoreTest, EpisodesThatCameBeforeTheirRunHoldNothing) {
  play(1, kSummer);  // nobody claims it yet
  EXPECT_TRUE(routes_.gaps(traversal()).map);
  const std::string run = begin_run(1);
  ASSERT_TRUE(routes_.keep(kSummer, map_of(160)));
  ASSERT_EQ(store_.remove(run), Store::Removal::kDone);
  EXPECT_EQ(number("SELECT COUNT(*) FROM maps"), 0);
}

TEST_F(RouteStoreTest, StaysWithinItsBudgets) {
  begin_run(1);
  RouteStore routes(store_, {.run_bytes = 100'000, .traversal_bytes = 40'000});
  EXPECT_EQ(fill(routes, traversal(), 1500), 26u) << "40,000 bytes a traversal";
  EXPECT_TRUE(routes.gaps(traversal()).places.empty());
  EXPECT_FALSE(routes.keep(kSummer, {{1, 0, 127}, 3}, picture(1500, 'z')));
  // Its other traversals share what is left of the run's budget.
  std::size_t all = 26;
  for (std::uint64_t hash = 1; hash <= 3; ++hash) {
    play(1, hash);
    all += fill(routes, traversal(hash), 1500);
  }
  EXPECT_EQ(all, 100'000u / 1500);
  EXPECT_LE(number("SELECT SUM(length(bytes)) FROM pictures"), 100'000);
  // The same traversal in a run of its own has its own budget, and what is there costs nothing more.
  EXPECT_TRUE(routes.gaps(traversal()).places.empty());
  EXPECT_FALSE(RouteStore(store_, {.map_frames = 100}).gaps(traversal()).map) << "a map too large";
}

TEST_F(RouteStoreTest, TakesThePlacesOfARunsPartOfALongTraversal) {
  begin_run(1, kSummer, R"({"first_frame":20000,"frames":1000})");
  begin_run(2, kSummer, R"({"first_frame":100,"frames":10})");
  begin_run(3, kSummer, "no JSON");
  begin_run(4, kSummer, R"({"first_frame":-5,"frames":99999999999})");
  const auto gaps = routes_.gaps(traversal(kSummer, 35'000));
  std::size_t first = 0, second = 0, all = 0;
  for (const auto& place : gaps.places) {
    EXPECT_LT(place.frame, 35'000u);
    const std::uint32_t frames = place.part.last - place.part.first + 1;
    first += frames == 1000;
    second += frames == 10;
    all += frames == 35'000;
  }
  EXPECT_GE(first, 120u);
  EXPECT_EQ(second, 10u);
  EXPECT_GE(all, 120u);
  EXPECT_LE(gaps.places.size(), 3u * 128);
  EXPECT_TRUE(routes_.gaps(traversal(kSummer, 0)).places.empty());
}

TEST_F(RouteStoreTest, KilledWhileItStoresItHasNothingHalf) {
  begin_run(1);
  const std::uint64_t frames = 2000;
  for (int round = 0; round < 5; ++round) {
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const std::string path = folder_ / ("killed-" + std::to_string(round));
    {
      Store store({path, 0});
      store.record(run_info());
      store.record(std::vector{episode(1)});
      store.describe(traversal_info());
    }
    const pid_t child = fork();
    if (child == 0) {
      try {
        Store store({path, 0});
        RouteStore routes(store, {.run_bytes = 1 << 30, .traversal_bytes = 1 << 30, .places = 100'000});
        for (std::uint32_t frame = 0;; ++frame) {
          if (frame % 50 == 0) routes.keep(kSummer, map_of(frames));
          if (!routes.keep(kSummer, {{1, 0, 100'000}, frame}, picture(20'000 + frame))) _exit(1);
          if (::write(ends[1], &frame, sizeof frame) != sizeof frame) _exit(1);
        }
      } catch (const std::exception&) {
        _exit(1);
      }
    }
    close(ends[1]);
    std::uint32_t told = 0;
    while (told < 3u + static_cast<std::uint32_t>(round)) ASSERT_EQ(::read(ends[0], &told, sizeof told), sizeof told);
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    while (::read(ends[0], &told, sizeof told) == sizeof told) {
    }
    close(ends[0]);
    Store store({path, 0});
    StoreReader reader(path);
    const auto map = reader.map(kSummer);
    ASSERT_TRUE(map);
    EXPECT_EQ(map->position.size(), frames);
    EXPECT_EQ(map->longitude.size(), frames);
    for (std::uint32_t frame = 0; frame <= told; ++frame) {
      const auto kept = reader.picture(kSummer, frame);
      ASSERT_TRUE(kept);
      EXPECT_EQ(kept->frame, frame) << "what was acknowledged is there";
      EXPECT_EQ(kept->picture.bytes, std::string(20'000 + frame, 'x'));
    }
    SQLite::Database database = open_database(path);
    EXPECT_EQ(database.execAndGet("SELECT COUNT(*) FROM pictures").getInt64(),
              database.execAndGet("SELECT COUNT(*) FROM places JOIN pictures ON id = picture").getInt64());
  }
}

}  // namespace
}  // namespace citylearn::testing
