// SPDX-License-Identifier: Apache-2.0
// What the dashboard's REST API takes and tells of alarms.
#include <gtest/gtest.h>

#include "tests/unit/dashboard/api/api_fixture.h"

namespace citylearn::testing {
namespace {

class ApiAlarms : public ApiTest {
 protected:
  static Api::Options with(Api::Options options, Alarms& alarms) {
    options.alarms = &alarms;
    return options;
  }
  Answer send(const std::string& method, const std::vector<std::string>& path, const Json& body) {
    return api_alarms_.answer({method, path, {}, body.dump()});
  }
  Json there() { return Json::parse(api_alarms_.answer({"GET", {"alarms"}, {}}).body); }
  void expect_refused(const std::string& naming, const Json& rule) {
    const Answer answer = send("POST", {"alarms"}, rule);
    EXPECT_EQ(answer.status, 400) << rule;
    EXPECT_TRUE(contains(Json::parse(answer.body).value("error", ""), naming)) << rule;
  }

  Alarms alarms_{store_, {std::chrono::milliseconds(0), {}}};
  Api api_alarms_{with(options_, alarms_), store_, &live_};
};

TEST_F(ApiAlarms, ARuleIsMadeRaisesAnAlarmAndGoes) {
  EXPECT_EQ(there(), (Json{{"rules", Json::array()}, {"alarms", Json::array()}}));
  store_.record(run_info());
  const Answer made = send(
      "POST", {"alarms"}, {{"runs", "demo/*"}, {"when", "below"}, {"figure", "reward"}, {"value", 0.6}, {"points", 2}});
  ASSERT_EQ(made.status, 200) << made.body;
  Json rule = Json::parse(made.body);
  EXPECT_GT(rule["created"], 1e9);
  EXPECT_EQ(there()["rules"], Json::array({rule}));
  rule.erase("created");
  EXPECT_EQ(rule, Json::parse(R"({"id": 1, "runs": "demo/*", "when": "below", "figure": "reward", "value": 0.6,
                                  "points": 2, "steps": 0.0, "minutes": 0.0, "text": "reward below 0.6 for 2 points"})"));
  store_.record(training_stats(1, 3));
  alarms_.poll();
  const Json raised = there()["alarms"];
  ASSERT_EQ(raised.size(), 1u);
  EXPECT_EQ(raised[0]["run"], id_);
  EXPECT_EQ(raised[0]["over"], nullptr);
  EXPECT_EQ(raised[0]["text"], "reward below 0.6 for 2 points: 0.5 at step 1024");
  EXPECT_EQ(json({"events"})["events"][0]["text"], raised[0]["text"]);
  const Answer over = send("PATCH", {"alarms", "1"}, {{"over", true}});
  EXPECT_EQ(over.status, 200) << over.body;
  EXPECT_TRUE(there()["alarms"][0]["over"].is_number());
  EXPECT_EQ(send("PATCH", {"alarms", "1"}, {{"over", true}}).status, 404);
  EXPECT_EQ(send("PATCH", {"alarms", "1"}, {{"over", false}}).status, 400);
  EXPECT_EQ(send("DELETE", {"alarms", "1"}, Json::object()).status, 204);
  EXPECT_EQ(send("DELETE", {"alarms", "1"}, Json::object()).status, 404);
  EXPECT_EQ(send("DELETE", {"alarms", "x"}, Json::object()).status, 404);
  EXPECT_EQ(send("DELETE", {"alarms"}, Json::object()).status, 405);
  EXPECT_EQ(there()["alarms"], Json::array());
}

TEST_F(ApiAlarms, WrongRulesAreToldWhatIsWrong) {
  store_.record(run_info());
  expect_refused("JSON object", Json::array());
  expect_refused("'when' must be below, above, not_finite, silent or lost", {{"when", "odd"}});
  expect_refused("'odd' is not known", {{"when", "lost"}, {"odd", 1}});
  expect_refused("'value' is missing", {{"when", "above"}, {"figure", "spl"}});
  expect_refused("'figure' is missing", {{"when", "not_finite"}});
  expect_refused("'figure' must be one line of at most 256 bytes", {{"when", "not_finite"}, {"figure", 5}});
  expect_refused("'when' must be one line", {{"when", "lost\n"}});
  expect_refused("'runs' must be one line of at most 512 bytes", {{"when", "lost"}, {"runs", std::string(513, 'a')}});
  expect_refused("'points' must be a whole number", {{"when", "not_finite"}, {"figure", "spl"}, {"points", 1.5}});
  expect_refused("'minutes' must be from", {{"when", "silent"}});
  expect_refused("'runs' must be", {{"when", "lost"}, {"runs", ""}});
  expect_refused("has a figure 'sqpl': trainings have update, steps", {{"when", "not_finite"}, {"figure", "sqpl"}});
  EXPECT_EQ(there()["rules"], Json::array());
}

TEST_F(ApiAlarms, RecordingsHaveNone) {
  EXPECT_EQ(json({"alarms"})["rules"], Json::array());
  EXPECT_EQ(api_.answer({"POST", {"alarms"}, {}, R"({"when": "lost"})"}).status, 409);
}

}  // namespace
}  // namespace citylearn::testing
