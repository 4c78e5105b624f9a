// SPDX-License-Identifier: Apache-2.0
// What is imported through a dashboard is what is imported into its store.
#include "tools/import/dashboard_sink.h"

#include <gtest/gtest.h>

#include "core/util/error.h"
#include "dashboard/api/api.h"
#include "dashboard/http/server.h"
#include "tests/support/files.h"
#include "tests/support/text.h"
#include "tools/import/log_writer.h"

namespace citylearn::testing {
namespace {

/// A dashboard without services.
struct RunningDashboard {
  explicit RunningDashboard(const std::string& store_path) : store({store_path, 0}), api({}, store, nullptr) {}

  static ServerOptions on_free_port() {
    ServerOptions options;
    options.port = 0;
    return options;
  }
  /// Returns all of the runs, their figures and points.
  std::string records() {
    const std::string points = "SELECT run, metric, step, time, value FROM curves ORDER BY 1, 2, 4, 3";
    const std::string runs =
        "SELECT r.name, r.source, r.log, r.manifest, r.received, r.updates, r.ended, m.name, m.points, m.step, "
        "m.value, "
        "m.least, m.greatest FROM runs r JOIN metrics m ON m.run = r.id ORDER BY 1, 8";
    std::string text;
    for (const std::string& sql : {points, runs})
      text += api.answer({"GET", {"sql"}, {{"q", sql}, {"limit", "100000"}, {"format", "csv"}}}).body;
    return text;
  }

  Store store;
  Api api;
  ClientHub hub;
  Server server{on_free_port(), hub, {[this](const Query& query) { return api.answer(query); }, {}}};
};

/// Logs a run of more points than one request may have; its last record has many metrics.
std::uint64_t log_run(const LogSink& sink) {
  LogWriter writer(sink, {"p/a", "tensorboard", "abc", 120'000});
  writer.begin({1000, "a title", {"tag"}, "a note"});
  writer.configure(R"({"rate":0.5})");
  for (int step = 0; step < 260'000; ++step) {
    writer.add(step % 2 == 0 ? "even" : "odd", step, 1000 + step * 0.001, 1.0 / (step + 3));
    if (step % 7 == 0) writer.add("seventh", step, 1000 + step * 0.001, step);
    writer.points_done();
  }
  for (int metric = 0; metric < 3000; ++metric) writer.add("many/" + std::to_string(metric), 1, 2000, metric);
  writer.points_done();
  writer.finish(true);
  return writer.points();
}

TEST(DashboardSink, BringsWhatTheStoreWouldGet) {
  Folder folder;
  RunningDashboard one(folder / "one.sqlite"), other(folder / "other.sqlite");
  LoggedRuns runs(other.store);
  const LogSink direct = [&](const std::string& id, const LogBatch& batch) { return runs.append(id, batch); };
  const std::uint64_t points = log_run(direct);
  EXPECT_EQ(points, 260'000u + 37143 + 3000);
  DashboardSink sink(one.server.url(), "");
  const LogSink send = [&](const std::string& id, const LogBatch& batch) { return sink.append(id, batch); };
  EXPECT_EQ(log_run(send), points);
  const std::string records = one.records();
  EXPECT_GT(records.size(), 1'000'000u);
  EXPECT_EQ(records, other.records());
  log_run(send);
  EXPECT_EQ(one.records(), records) << "once, however often it is sent";
}

TEST(DashboardSink, SaysWhatTheDashboardSays) {
  Folder folder;
  RunningDashboard dashboard(folder / "store.sqlite");
  DashboardSink sink(dashboard.server.url(), "");
  LogBatch batch(1);
  batch.source = "tensorboard";
  batch.log = "abc";
  batch.add("loss\n", 1, 2, 3);
  batch.points_done();
  try {
    sink.append("p/a", batch);
    FAIL();
  } catch (const Error& error) {
    EXPECT_TRUE(contains(error.what(), "refuses: 'metrics' of the header: a metric has a name of one line"))
        << error.what();
  }
}

TEST(LogWriter, WhatTheSinkDidNotTakeIsSaidAtTheNextCallOrAtTheEnd) {
  const LogSink full = [](const std::string&, const LogBatch&) -> LoggedRuns::Outcome {
    throw Error("the disk is full", "store");
  };
  LogWriter failing(full, {"p/a", "tensorboard", "abc", 1});
  failing.add("loss", 1, 2, 3);
  failing.points_done();
  EXPECT_THROW(failing.finish(true), Error);
  EXPECT_EQ(failing.points(), 0u);
  const LogSink another = [](const std::string&, const LogBatch&) { return LoggedRuns::Outcome{0, true}; };
  LogWriter refused(another, {"p/a", "tensorboard", "abc", 1});
  EXPECT_THROW(refused.finish(true), Error);
}

}  // namespace
}  // namespace citylearn::testing
