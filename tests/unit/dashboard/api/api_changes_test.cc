// SPDX-License-Identifier: Apache-2.0
// What the dashboard's REST API lets people change: tags and notes of runs.
#include <gtest/gtest.h>

#include "tests/unit/dashboard/api/api_fixture.h"

namespace citylearn::testing {
namespace {

class ApiChanges : public ApiTest {
 protected:
  Answer patch(const std::vector<std::string>& path, const std::string& body) {
    return api_.answer({"PATCH", path, {}, body});
  }
  void expect_refused(const std::string& naming, const std::vector<std::string>& path, const std::string& body) {
    const Answer answer = patch(path, body);
    EXPECT_EQ(answer.status, 400) << body << answer.body;
    EXPECT_TRUE(contains(Json::parse(answer.body).value("error", ""), naming)) << answer.body;
  }
};

TEST_F(ApiChanges, TagsAndNotesOfRuns) {
  store_.record(run_info());
  EXPECT_EQ(json({"runs", id_})["tags"], Json::array());
  EXPECT_EQ(json({"runs", id_})["note"], "");
  const std::string hostile = "<img src=x onerror=alert(1)>'; DROP TABLE runs; --";
  const Json both = {{"tags", {"baseline", hostile}}, {"note", "two\nlines \xE2\x9C\x93"}};
  const Answer answer = patch({"runs", id_}, both.dump());
  ASSERT_EQ(answer.status, 200) << answer.body;
  EXPECT_EQ(Json::parse(answer.body)["id"], id_);
  EXPECT_EQ(json({"runs", id_})["tags"], both["tags"]);
  EXPECT_EQ(json({"runs"})["runs"][0]["note"], both["note"]);
  // What is not given stays.
  EXPECT_EQ(patch({"runs", id_}, R"({"tags": []})").status, 200);
  EXPECT_EQ(json({"runs", id_})["tags"], Json::array());
  EXPECT_EQ(json({"runs", id_})["note"], both["note"]);
  // News of the run change neither.
  store_.record(run_info(5, 500, 2));
  EXPECT_EQ(json({"runs", id_})["note"], both["note"]);
}

TEST_F(ApiChanges, WrongTagsAndNotesAreToldWhatIsWrong) {
  store_.record(run_info());
  const std::vector<std::string> run = {"runs", id_};
  for (const char* tags :
       {"5", "\"a\"", "[5]", "[\"\"]", "[\" a\"]", "[\"a \"]", "[\"a\\nb\"]", "[\"a,b\"]", "[\"a\",\"a\"]"})
    expect_refused("'tags' must be", run, "{\"tags\": " + std::string(tags) + "}");
  expect_refused("'tags' must be", run, Json({{"tags", {std::string(65, 'a')}}}).dump());
  Json many = {{"tags", Json::array()}};
  for (int i = 0; i < 33; ++i) many["tags"].push_back(std::to_string(i));
  expect_refused("'tags' must be", run, many.dump());
  expect_refused("'note' must be", run, R"({"note": 5})");
  expect_refused("'note' must be", run, R"({"note": "a\u0000b"})");
  expect_refused("'note' must be", run, Json({{"note", std::string(2001, 'a')}}).dump());
  expect_refused("'notes' is not known here (tags, note)", run, R"({"notes": ""})");
  expect_refused("must be a JSON object", run, "[]");
  expect_refused("the body", run, "{");
  expect_refused("the body", run, "");
  expect_refused("the body", run, "{\"note\": \"\xFF\"}");
  EXPECT_EQ(patch({"runs", "nobody"}, "{}").status, 404);
  EXPECT_EQ(json(run)["tags"], Json::array());
}

TEST_F(ApiChanges, ARunOfARecordingGoesOnWhileItsPolicyServiceIsHeard) {
  store_.record(run_info());
  options_.replays = true;
  options_.silence = -1;
  const auto state = [&] { return Api(options_, store_, &live_).runs()["runs"][0]["state"]; };
  EXPECT_EQ(state(), "lost") << "its policy_service was never heard";
  live_.policy = true;
  EXPECT_EQ(state(), "running") << "however long ago that was: the recording may be slow";
  options_.silence = 5;
  live_.policy = false;
  EXPECT_EQ(state(), "lost");
}

}  // namespace
}  // namespace citylearn::testing
