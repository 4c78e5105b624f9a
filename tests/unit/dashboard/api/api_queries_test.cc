// SPDX-License-Identifier: Apache-2.0
// What the dashboard's REST API takes and tells of logged runs, what differs between runs, and SQL.
#include <gtest/gtest.h>

#include "dashboard/api/log_frame.h"
#include "tests/unit/dashboard/api/api_fixture.h"

namespace citylearn::testing {
namespace {

class ApiQueries : public ApiTest {
 protected:
  Answer post(const std::string& id, const Json& body) { return api_.answer({"POST", {"runs", id}, {}, body.dump()}); }
  static Json body(int first, const Json& records) {
    return {{"source", "python"}, {"log", "abc"}, {"first", first}, {"records", records}};
  }
  /// Logs a run of two metrics.
  void log_run(const std::string& id, double rate, double last) {
    const Json records = {{{"begin", {{"started", 1000.0}, {"title", "a title"}}}},
                          {{"config", {{"rate", rate}, {"net", {{"width", 8}, {"layers", {1, "x"}}}}}}},
                          {{"step", 0}, {"time", 1001.5}, {"values", {{"loss", 0.5}, {"a/b", nullptr}}}},
                          {{"step", 10}, {"time", 1003.0}, {"values", {{"loss", last}}}},
                          {{"summary", {{"best", last / 2}}}},
                          {{"end", 1003}}};
    const Answer answer = post(id, body(1, records));
    ASSERT_EQ(answer.status, 200) << answer.body;
    EXPECT_EQ(Json::parse(answer.body), (Json{{"id", id}, {"received", 6}}));
  }
  void expect_refused(const std::string& naming, const std::string& id, const Json& wrong, int status = 400) {
    const Answer answer = post(id, wrong);
    EXPECT_EQ(answer.status, status) << wrong << answer.body;
    EXPECT_TRUE(contains(Json::parse(answer.body).value("error", ""), naming)) << answer.body;
  }
  Answer sql(const std::string& text, Parameters parameters = {}) {
    parameters["q"] = text;
    return ask({"sql"}, parameters);
  }
};

TEST_F(ApiQueries, ALoggedRunIsAmongTheRuns) {
  log_run("p/a", 0.1, 0.25);
  const Json runs = json({"runs"})["runs"];
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0]["id"], "p/a");
  EXPECT_EQ(runs[0]["session"], "p");
  EXPECT_EQ(runs[0]["source"], "python");
  EXPECT_EQ(runs[0]["title"], "a title");
  EXPECT_EQ(runs[0]["state"], "ended");
  EXPECT_EQ(runs[0]["updates"], 2);
  EXPECT_EQ(json({"runs", "p/a"})["manifest"]["rate"], 0.1);
}

TEST_F(ApiQueries, MetricsAndCurves) {
  log_run("p/a", 0.1, 0.25);
  const Json metrics = json({"runs", "p/a", "metrics"})["metrics"];
  ASSERT_EQ(metrics.size(), 2u);
  EXPECT_EQ(metrics[0], Json::parse(R"({"name": "a/b", "points": 1, "step": 0.0, "value": null, "least": null,
                                        "greatest": null})"));
  EXPECT_EQ(metrics[1], Json::parse(R"({"name": "loss", "points": 2, "step": 10.0, "value": 0.25, "least": 0.25,
                                        "greatest": 0.5})"));
  const Json curve = json({"runs", "p/a", "curve"}, {{"metric", "loss"}});
  EXPECT_EQ(curve["columns"], (Json{{"x", {0, 10}}, {"value", {0.5, 0.25}}}));
  EXPECT_EQ(curve["total"], 2);
  EXPECT_EQ(curve["decimated"], false);
  EXPECT_EQ(json({"runs", "p/a", "curve"}, {{"metric", "loss"}, {"x", "wall"}})["columns"]["x"], (Json{1.5, 3}));
  EXPECT_EQ(json({"runs", "p/a", "curve"}, {{"metric", "loss"}, {"x", "records"}})["columns"]["x"], (Json{3, 4}));
  EXPECT_EQ(json({"runs", "p/a", "curve"}, {{"metric", "loss"}, {"from", "5"}})["columns"]["x"], (Json{10}));
  EXPECT_EQ(json({"runs", "p/a", "curve"}, {{"metric", "loss"}, {"x", "wall"}, {"to", "2"}})["columns"]["x"],
            (Json{1.5}));
  EXPECT_EQ(json({"runs", "p/a", "curve"}, {{"metric", "a/b"}})["columns"]["value"], (Json{nullptr}));
  expect_error(404, "no metric 'spl'", {"runs", "p/a", "curve"}, {{"metric", "spl"}});
  expect_error(400, "'metric' is missing", {"runs", "p/a", "curve"});
  expect_error(400, "'x' must be", {"runs", "p/a", "curve"}, {{"metric", "loss"}, {"x", "epochs"}});
}

TEST_F(ApiQueries, WrongLogsAreToldWhatIsWrong) {
  const Json point = {{"step", 0}, {"time", 1}, {"values", {{"loss", 1}}}};
  for (const char* id : {"p", "p/a/b"}) expect_refused("PROJECT/NAME", id, body(1, Json::array()));
  expect_refused("names of 1 to 128 bytes", "p/", body(1, Json::array()));
  expect_refused("'first'", "p/a", body(0, Json::array()));
  expect_refused("'records'", "p/a", body(1, 5));
  expect_refused("record 2: ", "p/a", body(1, {point, {{"nothing", 1}}}));
  expect_refused("'step' and 'time'", "p/a", body(1, {{{"values", {{"loss", 1}}}, {"time", 5}}}));
  expect_refused("'loss' must be a number", "p/a", body(1, {{{"step", 1}, {"time", 5}, {"values", {{"loss", "1"}}}}}));
  expect_refused("one line", "p/a", body(1, {{{"step", 1}, {"time", 5}, {"values", {{"a\nb", 1}}}}}));
  expect_refused("'note' must be", "p/a", body(1, {{{"begin", {{"note", 5}}}}}));
  expect_refused("'title' must be one line of at most 256 bytes", "p/a", body(1, {{{"begin", {{"title", 5}}}}}));
  Json nameless = body(1, Json::array());
  nameless.erase("log");
  expect_refused("'source' and 'log'", "p/a", nameless);
  Json odd = body(1, Json::array());
  odd["odd"] = 1;
  expect_refused("'odd' is not known", "p/a", odd);
  EXPECT_EQ(json({"runs"})["runs"], Json::array()) << "nothing of it was kept";
  ASSERT_EQ(post("p/a", body(1, Json::array({point}))).status, 200);
  Json other = body(2, Json::array({point}));
  other["log"] = "another";
  expect_refused("another program", "p/a", other, 409);
}

TEST_F(ApiQueries, PointsComeAsNumbersToo) {
  const auto post_frame = [&](const std::string& frame) {
    return api_.answer({"POST", {"runs", "p/a"}, {}, frame, kLogFrameType});
  };
  LogBatch batch(1);
  batch.source = "tensorboard";
  batch.log = "abc";
  batch.ended = true;
  batch.add("loss", 3, 5, 0.5);
  batch.points_done();
  batch.add("loss", 4, 6, 0.25);
  batch.points_done();
  for (int times = 0; times < 2; ++times) {
    const Answer answer = post_frame(log_frame(batch, 0, 2, true));
    EXPECT_EQ(answer.status, 200);
    EXPECT_EQ(Json::parse(answer.body), (Json{{"id", "p/a"}, {"received", 2}}));
  }
  EXPECT_EQ(json({"runs", "p/a", "curve"}, {{"metric", "loss"}})["columns"],
            (Json{{"x", {3, 4}}, {"value", {0.5, 0.25}}}));
  EXPECT_EQ(json({"runs", "p/a"})["state"], "ended");
  EXPECT_EQ(post_frame("{}").status, 400);
  batch.log = "";
  EXPECT_TRUE(contains(post_frame(log_frame(batch, 0, 2, true)).body, "'source' and 'log'"));
  batch.log = "another";
  EXPECT_EQ(post_frame(log_frame(batch, 0, 2, true)).status, 409);
}

TEST_F(ApiQueries, OnlyWhatDiffersIsCompared) {
  log_run("p/a", 0.1, 0.25);
  log_run("p/b", 0.2, 0.25);
  store_.record(run_info());
  const Json two = json({"compare"}, {{"runs", "p/a\np/b"}});
  EXPECT_EQ(two["runs"], (Json{"p/a", "p/b"}));
  EXPECT_EQ(two["config"], Json::parse(R"([{"key": "rate", "values": ["0.1", "0.2"], "differs": true}])"));
  EXPECT_EQ(two["figures"], Json::array());
  const Json all = json({"compare"}, {{"runs", "p/a\np/b"}, {"all", "1"}});
  ASSERT_EQ(all["config"].size(), 3u);
  EXPECT_EQ(all["config"][0], Json::parse(R"({"key": "net.layers", "values": ["1, x", "1, x"], "differs": false})"));
  EXPECT_EQ(all["figures"].size(), 2u);
  EXPECT_EQ(all["figures"][0], Json::parse(R"({"key": "best", "values": ["0.125", "0.125"], "differs": false})"));
  // What one run does not have differs; a run of which nothing is known differs in nothing.
  const Json mixed = json({"compare"}, {{"runs", "p/a\n" + id_}});
  for (const Json& row : mixed["figures"]) EXPECT_NE(row["key"], "loss");
  expect_error(404, "run 'p/c' not found", {"compare"}, {{"runs", "p/a\np/c"}});
  expect_error(400, "'runs' must be", {"compare"});
}

TEST_F(ApiQueries, SqlReadsEverything) {
  log_run("p/a", 0.1, 0.25);
  const Answer rows = sql("SELECT metric, step, value FROM curves WHERE run = 'p/a' ORDER BY metric, step");
  ASSERT_EQ(rows.status, 200) << rows.body;
  EXPECT_EQ(Json::parse(rows.body), Json::parse(R"({"columns": ["metric", "step", "value"], "truncated": false,
    "rows": [["a/b", 0, null], ["loss", 0, 0.5], ["loss", 10, 0.25]]})"));
  EXPECT_EQ(sql("SELECT name, '=1+1' AS f FROM runs", {{"format", "csv"}}).body, "name,f\np/a,'=1+1\n");
  const Json first = Json::parse(sql("SELECT step FROM curves;", {{"limit", "1"}}).body);
  EXPECT_EQ(first["rows"].size(), 1u);
  EXPECT_EQ(first["truncated"], true);
  EXPECT_EQ(api_.answer({"POST", {"sql"}, {}, "SELECT 1 AS one"}).body,
            R"({"columns":["one"],"rows":[[1]],"truncated":false})");
}

TEST_F(ApiQueries, SqlCanOnlyRead) {
  log_run("p/a", 0.1, 0.25);
  for (const char* wrong :
       {"DELETE FROM runs", "UPDATE runs SET note = 'x'", "DROP TABLE runs", "PRAGMA journal_mode = DELETE",
        "ATTACH '/etc/passwd' AS other", "CREATE TEMP TABLE t (x)", "VACUUM INTO '/tmp/copy'", "BEGIN IMMEDIATE",
        "SELECT load_extension('x')", "SELECT 1; DELETE FROM runs", "WITH x AS (SELECT 1) DELETE FROM runs", "",
        "-- nothing", "SELECT * FROM nowhere", "SELEKT 1"}) {
    const Answer answer = sql(wrong);
    EXPECT_EQ(answer.status, 400) << wrong << answer.body;
  }
  EXPECT_EQ(json({"runs"})["runs"].size(), 1u);
  EXPECT_EQ(json({"runs"})["runs"][0]["note"], "");
}

TEST_F(ApiQueries, SqlIsBoundedInTimeRowsAndBytes) {
  const std::string endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) ";
  const auto begin = std::chrono::steady_clock::now();
  const Answer late = sql(endless + "SELECT COUNT(*) FROM n");
  EXPECT_EQ(late.status, 400);
  EXPECT_TRUE(contains(late.body, "took longer than"));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(60));
  const Json many = Json::parse(sql(endless + "SELECT i FROM n", {{"limit", "100000"}}).body);
  EXPECT_EQ(many["rows"].size(), 100'000u);
  const Answer large = sql(endless + "SELECT hex(zeroblob(1000000)) FROM n");
  EXPECT_LT(large.body.size(), 20u << 20);
  EXPECT_EQ(sql("SELECT hex(zeroblob(100000000))").status, 400);
  expect_error(400, "'limit' must be", {"sql"}, {{"q", "SELECT 1"}, {"limit", "0"}});
}

}  // namespace
}  // namespace citylearn::testing
