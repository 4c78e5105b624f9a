// SPDX-License-Identifier: Apache-2.0
// What the dashboard's REST API tells of the differences between runs.
#include <gtest/gtest.h>

#include "dashboard/store/database.h"
#include "tests/unit/dashboard/api/api_fixture.h"

namespace citylearn::testing {
namespace {

class ApiCompare : public ApiTest {
 protected:
  /// Records a run and returns its ID.
  std::string record_run(std::uint64_t seed, double rate) {
    msg::RunInfo info = run_info();
    info.seed(seed);
    const std::string manifest =
        Json{{"rate", rate}, {"net", {{"width", 8}, {"layers", {1, "x"}}}}, {"artefacts", {{"folder", rate}}}}.dump();
    info.manifest(std::vector<std::uint8_t>(manifest.begin(), manifest.end()));
    store_.record(info);
    return run_id(info);
  }
};

TEST_F(ApiCompare, OnlyWhatDiffersIsTold) {
  const std::string a = record_run(1, 0.1), b = record_run(2, 0.2);
  const Json two = json({"compare"}, {{"runs", a + "\n" + b}});
  EXPECT_EQ(two["runs"], (Json{a, b}));
  EXPECT_EQ(two["config"], Json::parse(R"([{"key": "rate", "values": ["0.1", "0.2"], "differs": true}])"));
  const Json all = json({"compare"}, {{"runs", a + "\n" + b}, {"all", "1"}});
  ASSERT_EQ(all["config"].size(), 3u);
  EXPECT_EQ(all["config"][0], Json::parse(R"({"key": "net.layers", "values": ["1, x", "1, x"], "differs": false})"));
  expect_error(404, "run 'p/c' not found", {"compare"}, {{"runs", a + "\np/c"}});
  expect_error(400, "'runs' must be", {"compare"});
}

TEST_F(ApiCompare, ARunOfWhichNothingIsKnownDiffersInNothing) {
  const std::string a = record_run(1, 0.1);
  store_.record(std::vector{episode(1, "env-summer", 7, kJob + 9)});
  EXPECT_EQ(json({"compare"}, {{"runs", a + "\ndemo"}})["config"], Json::array());
}

TEST_F(ApiCompare, RunsThatOtherProgramsLoggedOnceAreKeptAndNotShown) {
  store_.with_database([](SQLite::Database& database) {
    database.exec("INSERT INTO runs (name, session, started, last, source) VALUES ('p/a', 'p', 1, 2, 'wandb')");
  });
  EXPECT_EQ(json({"runs"})["runs"], Json::array());
  expect_error(404, "run 'p/a' not found", {"runs", "p/a"});
  store_.with_database(
      [](SQLite::Database& database) { EXPECT_EQ(database.execAndGet("SELECT COUNT(*) FROM runs").getInt(), 1); });
}

}  // namespace
}  // namespace citylearn::testing
