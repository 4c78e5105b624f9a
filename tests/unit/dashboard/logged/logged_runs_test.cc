// SPDX-License-Identifier: Apache-2.0
// Runs that programs log: in the store, each record once, whatever is sent again.
#include "dashboard/logged/logged_runs.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/util/error.h"
#include "dashboard/query/curve_reader.h"
#include "dashboard/query/sql_query.h"
#include "dashboard/store/store_reader.h"
#include "tests/support/files.h"
#include "tests/support/records/records.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr const char* kId = "project/a";

class LoggedRunsTest : public ::testing::Test {
 protected:
  static LogBatch batch(std::uint64_t first, const std::string& log = "log") {
    LogBatch made(first);
    made.source = "python";
    made.log = log;
    return made;
  }
  /// Records first..last, of which each has the value 10 * number for `loss`, at a step of its number.
  static LogBatch points(std::uint64_t first, std::uint64_t last) {
    LogBatch made = batch(first);
    for (std::uint64_t number = first; number <= last; ++number) {
      made.add("loss", static_cast<double>(number), 1000 + static_cast<double>(number),
               10.0 * static_cast<double>(number));
      made.points_done();
    }
    return made;
  }
  Decimator curve(const std::string& metric, std::size_t most = 100) {
    CurveReader reader(path_);
    const auto rows =
        reader.curve({StoreReader(path_).run(kId).value().id, metric, CurveReader::Axis::kSteps, 0, {}, {}}, most);
    EXPECT_TRUE(rows) << metric;
    return rows.value_or(Decimator(1, 2, 0, 0));
  }
  std::int64_t number(const std::string& sql) {
    return std::get<std::int64_t>(SqlQuery::run(path_, sql, {}).rows.at(0).at(0));
  }

  Folder folder_;
  const std::string path_ = folder_ / "dashboard.sqlite";
  Store store_{{path_, 0}};
  LoggedRuns runs_{store_};
};

TEST_F(LoggedRunsTest, EachRecordIsTakenOnceInItsOrder) {
  EXPECT_EQ(runs_.append(kId, points(1, 5)).received, 5u);
  EXPECT_EQ(runs_.append(kId, points(1, 5)).received, 5u) << "sent again";
  EXPECT_EQ(runs_.append(kId, points(7, 9)).received, 5u) << "behind a gap: the sender goes on with 6";
  EXPECT_EQ(runs_.append(kId, points(4, 8)).received, 8u) << "overlaps";
  EXPECT_EQ(runs_.append(kId, batch(1)).received, 8u) << "asks how far the store is";
  const Decimator rows = curve("loss");
  ASSERT_EQ(rows.rows(), 8u);
  for (std::size_t row = 0; row < 8; ++row) {
    EXPECT_EQ(rows.values()[2 * row], static_cast<double>(row) + 1);
    EXPECT_EQ(rows.values()[2 * row + 1], 10 * (static_cast<double>(row) + 1));
  }
  const std::vector<MetricRow> metrics = CurveReader(path_).metrics(StoreReader(path_).run(kId).value().id);
  ASSERT_EQ(metrics.size(), 1u);
  EXPECT_EQ(metrics[0].points, 8u);
  EXPECT_EQ(metrics[0].value, 80);
  EXPECT_EQ(metrics[0].least, 10);
  EXPECT_EQ(metrics[0].greatest, 80);
}

TEST_F(LoggedRunsTest, WhatWasAcknowledgedIsInTheFile) {
  runs_.append(kId, points(1, 5));
  // Another connection sees what is committed alone.
  EXPECT_EQ(number("SELECT COUNT(*) FROM points"), 5);
  EXPECT_EQ(number("SELECT received FROM runs"), 5);
}

TEST_F(LoggedRunsTest, TwoLogsOfOneRunAreNotMixed) {
  runs_.append(kId, points(1, 5));
  LogBatch other = batch(6, "another");
  other.add("loss", 1, 1, 1);
  other.points_done();
  EXPECT_TRUE(runs_.append(kId, other).other_log);
  EXPECT_EQ(curve("loss").rows(), 5u);
}

TEST_F(LoggedRunsTest, OptionsAreMergedAndEndsAreKnown) {
  LogBatch first = batch(1);
  first.begin({1234.5, "first try", {"night"}, "a note"});
  first.configure(R"({"rate": 0.1, "net": {"width": 8}})");
  runs_.append(kId, first);
  LogBatch second = batch(3);
  second.configure(R"({"rate": 0.2})");
  second.summarise(R"({"best": 0.9})");
  second.end();
  EXPECT_EQ(runs_.append(kId, second).received, 5u);
  StoreReader reader(path_);
  const RunRow run = reader.run(kId).value();
  EXPECT_EQ(run.session, "project");
  EXPECT_EQ(run.source, "python");
  EXPECT_EQ(run.title, "first try");
  EXPECT_EQ(run.tags, std::vector<std::string>{"night"});
  EXPECT_EQ(run.note, "a note");
  EXPECT_EQ(run.started, 1234.5);
  EXPECT_TRUE(run.ended);
  EXPECT_EQ(reader.manifest(run.id), R"({"net":{"width":8},"rate":0.2})");
  EXPECT_EQ(CurveReader(path_).summary(run.id), R"({"best":0.9})");
  // The program goes on; what people have written stays.
  store_.annotate(kId, {}, "of a person");
  LogBatch third = batch(6);
  third.begin({1234.5, "", {}, "another"});
  runs_.append(kId, third);
  EXPECT_FALSE(StoreReader(path_).run(kId).value().ended);
  EXPECT_EQ(StoreReader(path_).run(kId).value().note, "of a person");
  EXPECT_EQ(StoreReader(path_).run(kId).value().title, "first try");
}

TEST_F(LoggedRunsTest, NumbersThatAreNoneAreGaps) {
  LogBatch some = batch(1);
  for (const double value : {1.0, std::nan(""), 3.0}) {
    some.add("loss", 0, 0, value);
    some.points_done();
  }
  runs_.append(kId, some);
  const Decimator rows = curve("loss");
  ASSERT_EQ(rows.rows(), 3u);
  EXPECT_TRUE(std::isnan(rows.values()[3]));
  EXPECT_EQ(CurveReader(path_).metrics(StoreReader(path_).run(kId).value().id)[0].value, 3);
}

TEST_F(LoggedRunsTest, RemovingARunRemovesItsPoints) {
  LogBatch some = points(1, 5);
  some.end();
  runs_.append(kId, some);
  runs_.append("project/b", points(1, 3));
  EXPECT_EQ(store_.remove(kId), Store::Removal::kDone);
  EXPECT_EQ(number("SELECT COUNT(*) FROM points"), 3);
  EXPECT_EQ(number("SELECT COUNT(*) FROM metrics"), 1);
  EXPECT_EQ(runs_.append(kId, points(6, 9)).received, 0u) << "the sender begins again";
}

TEST_F(LoggedRunsTest, TooManyMetricsAreRefusedAndNothingIsKept) {
  LogBatch many = batch(1);
  for (std::size_t i = 0; i <= kMostMetrics; ++i) many.add("loss at " + std::to_string(i), 0, 0, 0);
  many.points_done();
  EXPECT_THROW(runs_.append(kId, many), Error);
  EXPECT_EQ(number("SELECT COUNT(*) FROM metrics"), 0);
}

TEST_F(LoggedRunsTest, EpisodesOfASessionAreNotARunOfTheProjectOfThatName) {
  runs_.append("demo/a", points(1, 2));
  store_.record(episodes(1, 3));  // of the session demo, before its RunInfo
  EXPECT_EQ(StoreReader(path_).run("demo/a").value().recorded, 0u);
  EXPECT_EQ(StoreReader(path_).runs().size(), 2u);
}

TEST(LoggedId, HasAProjectAndAName) {
  for (const char* right : {"p/a", "p%2Fq/a%25", "\xC3\xA9/x y"}) EXPECT_FALSE(fault_of_logged_id(right)) << right;
  for (const char* wrong : {"", "p", "p/", "/a", "p/a/1", "session/policy/1/2", "p/a\n", "p/\x80"})
    EXPECT_TRUE(fault_of_logged_id(wrong)) << wrong;
  EXPECT_TRUE(fault_of_logged_id("p/" + std::string(129, 'a')));
}

}  // namespace
}  // namespace citylearn::testing
