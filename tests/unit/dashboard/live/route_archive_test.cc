// SPDX-License-Identifier: Apache-2.0
// What is stored of routes while env_services host them: each place once, one at a time, whatever fails meanwhile.
#include "dashboard/live/route_archive.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "core/files/image_header.h"
#include "dashboard/store/database.h"
#include "dashboard/store/store_reader.h"
#include "tests/support/data/sample_pictures.h"
#include "tests/support/files.h"
#include "tests/support/records/records.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

constexpr std::uint64_t kHash = 0xFEDCBA9876543210;

/// Two env_services with a traversal each. Pictures come at the second time of asking.
class FakeRoutes : public RouteSource {
 public:
  FakeRoutes() {
    for (std::uint64_t i = 0; i < 2; ++i) {
      TraversalRow row;
      row.hash = kHash + i;
      row.frames = 40;
      row.images = true;
      rows.push_back(row);
    }
    cv::imencode(".png", drawn_picture(640, 360, 3), png);
  }
  std::vector<TraversalRow> hosted() override { return rows; }
  std::shared_ptr<const RouteMap> route_map(std::uint64_t) override {
    if (++maps % 3 != 0) return nullptr;
    auto map = std::make_shared<RouteMap>();
    map->frames = 40;
    map->position.assign(40, 1.5f);
    return map;
  }
  SparePicture spare_picture(const PictureKey& key) override {
    if (busy) return {};
    if (!coming) {
      coming = key;
      asked.push_back(key);
      return {nullptr, true};
    }
    EXPECT_EQ(*coming, key) << "one at a time";
    coming.reset();
    if (key.frame == unreadable) return {std::make_shared<PictureFile>(), false};
    if (key.frame == lost) return {};
    return {std::make_shared<PictureFile>(PictureFile{"image/png", std::string(png.begin(), png.end())}), false};
  }

  std::vector<TraversalRow> rows;
  std::vector<std::uint8_t> png;
  std::optional<PictureKey> coming;
  std::vector<PictureKey> asked;
  std::uint32_t unreadable = 1000, lost = 1000;
  bool busy = false;
  int maps = 0;
};

class RouteArchiveTest : public ::testing::Test {
 protected:
  RouteArchiveTest() {
    store_.record(run_info());
    for (std::uint64_t i = 0; i < 2; ++i) {
      const std::string environment = "env-" + std::to_string(i);
      store_.record(std::vector{episode(1 + i, environment)});
      msg::TraversalInfo info = traversal_info(environment);
      info.hash(kHash + i);
      store_.describe(info);
    }
  }
  std::int64_t number(const std::string& sql) { return open_database(store_.path()).execAndGet(sql).getInt64(); }
  std::int64_t places() { return number("SELECT COUNT(*) FROM places"); }
  bool until(const std::function<bool()>& condition) {
    return eventually([this] { archive_.poll(); }, condition);
  }

  Folder folder_;
  Store store_{{folder_ / "dashboard.sqlite", 0}};
  FakeRoutes routes_;
  RouteArchive::Options options_{{160, 4096}, milliseconds(0), milliseconds(0), milliseconds(50), milliseconds(200)};
  RouteArchive archive_{RouteStore(store_), routes_, options_};
};

TEST_F(RouteArchiveTest, StoresMapsAndSmallPicturesOfAllPlacesOnce) {
  ASSERT_TRUE(until([&] { return places() == 80 && number("SELECT COUNT(*) FROM maps") == 2; }));
  EXPECT_EQ(number("SELECT COUNT(*) FROM pictures"), 1) << "all places look the same";
  EXPECT_EQ(routes_.asked.size(), 80u) << "each is asked for once";
  // By turns, and spread: the first ones of each traversal are its ends and middle.
  std::map<std::uint64_t, std::vector<std::uint32_t>> first;
  for (std::size_t i = 0; i < 20; ++i) first[routes_.asked[i].hash].push_back(routes_.asked[i].frame);
  ASSERT_EQ(first.size(), 2u);
  for (const auto& [hash, frames] : first) {
    ASSERT_GE(frames.size(), 8u);
    EXPECT_EQ(std::vector(frames.begin(), frames.begin() + 4), (std::vector<std::uint32_t>{0, 32, 16, 8}));
  }
  const auto stored = StoreReader(store_.path()).picture(kHash, 39);
  ASSERT_TRUE(stored);
  EXPECT_EQ(stored->picture.type, "image/jpeg");
  EXPECT_EQ(read_image_header(std::as_bytes(std::span(stored->picture.bytes)), "picture").width, 160);
  const std::size_t asked = routes_.asked.size();
  const Clock::time_point since = Clock::now();
  ASSERT_TRUE(until([&] { return Clock::now() > since + milliseconds(200); }));
  EXPECT_EQ(routes_.asked.size(), asked) << "nothing is missing";
}

TEST_F(RouteArchiveTest, WaitsWhileOthersAreServed) {
  routes_.busy = true;
  const Clock::time_point since = Clock::now();
  ASSERT_TRUE(until([&] { return Clock::now() > since + milliseconds(100); }));
  EXPECT_EQ(places(), 0);
  routes_.busy = false;
  EXPECT_TRUE(until([&] { return places() == 80; }));
}

TEST_F(RouteArchiveTest, GoesOnBehindPicturesThatCannotBeHadAndAsksForThemAgain) {
  routes_.unreadable = 20;
  routes_.lost = 30;
  ASSERT_TRUE(until([&] { return places() == 76; }));
  routes_.unreadable = routes_.lost = 1000;
  EXPECT_TRUE(until([&] { return places() == 80; }));
}

TEST_F(RouteArchiveTest, AStoreThatFailsIsTriedAgain) {
  store_.with_database([](SQLite::Database& database) { database.exec("ALTER TABLE places RENAME TO elsewhere"); });
  const Clock::time_point since = Clock::now();
  ASSERT_TRUE(until([&] { return Clock::now() > since + milliseconds(50); }));
  store_.with_database([](SQLite::Database& database) { database.exec("ALTER TABLE elsewhere RENAME TO places"); });
  EXPECT_TRUE(until([&] { return places() == 80; }));
}

TEST_F(RouteArchiveTest, AnEnvServiceThatGoesIsMissedByNobody) {
  ASSERT_TRUE(until([&] { return places() >= 10; }));
  routes_.rows.clear();
  routes_.coming.reset();
  routes_.busy = true;
  const Clock::time_point since = Clock::now();
  ASSERT_TRUE(until([&] { return Clock::now() > since + milliseconds(100); }));
  EXPECT_LT(places(), 80);
  routes_ = FakeRoutes();
  EXPECT_TRUE(until([&] { return places() == 80; }));
}

}  // namespace
}  // namespace citylearn::testing
