// SPDX-License-Identifier: Apache-2.0
// What the dashboard's REST API lets people change: tags and notes of runs, and how a recording is played.
#include <gtest/gtest.h>

#include "tests/unit/dashboard/api/api_fixture.h"

namespace citylearn::testing {
namespace {

class FakePlayback : public PlaybackControl {
 public:
  ReplayState state() const override { return played; }
  std::uint64_t generation() const override { return 3; }
  std::shared_ptr<const RecordingOutline> outline() const override { return measured; }
  void change(const PlaybackChange& change) override { changed = change; }

  ReplayState played{1.5, 0, true};
  std::shared_ptr<RecordingOutline> measured;
  PlaybackChange changed;
};

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

TEST_F(ApiChanges, ARecordingIsSteered) {
  EXPECT_EQ(ask({"playback"}).status, 404);
  EXPECT_TRUE(contains(ask({"playback"}).body, "--open FILE"));
  EXPECT_EQ(patch({"playback"}, "{}").status, 404);
  FakePlayback playback;
  options_.playback = &playback;
  Api api(options_, store_, &live_);
  const auto answered = [&](const Query& query) {
    const Answer answer = api.answer(query);
    EXPECT_EQ(answer.status, 200) << answer.body;
    return Json::parse(answer.body);
  };
  Json state = answered({"GET", {"playback"}, {}});
  EXPECT_EQ(state, Json::parse(R"({"position": 1.5, "length": null, "speed": "max", "paused": true, "seeking": false,
                                   "ended": false, "generation": 3, "runs": {}, "marks": null, "spans": null})"));
  playback.measured = std::make_shared<RecordingOutline>();
  playback.measured->seconds = 60;
  playback.measured->episodes[99] = 7;
  state = answered({"PATCH", {"playback"}, {}, R"({"paused": false, "speed": 0.25, "position": 30})"});
  EXPECT_EQ(playback.changed.paused, false);
  EXPECT_EQ(playback.changed.speed, 0.25);
  EXPECT_EQ(playback.changed.position, 30);
  EXPECT_EQ(state["length"], 60);
  EXPECT_EQ(state["marks"]["episodes"].size(), 100u);
  EXPECT_EQ(state["marks"]["episodes"][99], 7);
  answered({"PATCH", {"playback"}, {}, R"({"speed": "max"})"});
  EXPECT_EQ(playback.changed.speed, 0) << "as fast as it can";
  EXPECT_FALSE(playback.changed.position || playback.changed.paused);
  for (const char* wrong : {R"({"paused": 1})", R"({"speed": 0})", R"({"speed": "fast"})", R"({"speed": 1e9})",
                            R"({"position": -1})", R"({"position": "1"})", R"({"seek": 1})", "1"}) {
    const Answer answer = api.answer({"PATCH", {"playback"}, {}, wrong});
    EXPECT_EQ(answer.status, 400) << wrong << answer.body;
  }
  EXPECT_EQ(api.answer({"DELETE", {"playback"}, {}}).headers.at(0).second, "GET, PATCH");
}

TEST_F(ApiChanges, AMomentOfARunIsAPositionOfTheRecording) {
  FakePlayback playback;
  options_.playback = &playback;
  Api api(options_, store_, &live_);
  const auto change = [&](const Json& moment, const char* more = "{}") {
    Json body = Json::parse(more);
    body["moment"] = moment;
    playback.changed = {};
    return api.answer({"PATCH", {"playback"}, {}, body.dump()});
  };
  const auto at = [&](const char* axis, double value) { return Json{{"run", id_}, {axis, value}}; };
  const Answer early = change(at("steps", 1));
  EXPECT_EQ(early.status, 503) << "the file is being read";
  EXPECT_EQ(early.headers.at(0).first, "Retry-After");

  playback.measured = std::make_shared<RecordingOutline>();
  playback.measured->seconds = 60;
  // Resumed from the checkpoint after update 1: update 2 comes twice.
  playback.measured->runs = {
      {"demo",
       "policy",
       1,
       kJob,
       {{1, 1, 512, 10, .25}, {2, 2, 1024, 20, .5}, {9, 2, 1024, 21, .5}, {20, 3, 1536, 30, .75}}}};
  Json state = Json::parse(api.answer({"GET", {"playback"}, {}}).body);
  const Json first = {{"update", 1}, {"steps", 512}, {"episodes", 10}, {"wall", .25}};
  EXPECT_EQ(state["runs"], (Json{{id_, first}})) << "at 1.5 s";
  EXPECT_EQ(state["spans"][id_]["first"], first);
  EXPECT_EQ(state["spans"][id_]["last"]["update"], 3);

  ASSERT_EQ(change(at("steps", 1500), R"({"paused": true})").status, 200);
  EXPECT_EQ(playback.changed.position, 20) << "of the nearest update";
  EXPECT_EQ(playback.changed.paused, true);
  change(at("wall", 1e9));
  EXPECT_EQ(playback.changed.position, 20) << "of the last one";
  change(at("update", 2));
  EXPECT_EQ(playback.changed.position, 9) << "the newer one of two";
  change(at("episodes", 3));
  EXPECT_FALSE(playback.changed.position) << "it is there: at 1.5 s the first update is the newest";
  playback.played.position = 5;
  change(at("update", 2));
  EXPECT_FALSE(playback.changed.position) << "it is there, at the older one of two";
  playback.played.seeking = true;
  change(at("update", 2));
  EXPECT_EQ(playback.changed.position, 9) << "it was on its way to elsewhere";
  playback.played.position = 0.5;
  EXPECT_EQ(Json::parse(api.answer({"GET", {"playback"}, {}}).body)["runs"], Json::object())
      << "before the first update";

  for (const Json& wrong : {Json(5), Json::object(), Json{{"run", id_}}, Json{{"run", id_}, {"steps", -1}},
                            Json{{"run", id_}, {"steps", 1}, {"wall", 1}}, Json{{"run", id_}, {"seconds", 1}}}) {
    const Answer answer = change(wrong);
    EXPECT_EQ(answer.status, 400) << wrong;
    EXPECT_TRUE(contains(answer.body, "one number from 0 on: update, steps, episodes, wall")) << answer.body;
  }
  EXPECT_TRUE(contains(change({{"run", 5}, {"steps", 1}}).body, "'run' must be one line of at most 1024 bytes"));
  EXPECT_EQ(change(at("steps", 1), R"({"position": 1})").status, 400);
  const Answer unknown = change({{"run", "demo/other/1/1"}, {"steps", 1}});
  EXPECT_EQ(unknown.status, 404);
  EXPECT_TRUE(contains(unknown.body, "no update of run 'demo/other/1/1'")) << unknown.body;
}

TEST_F(ApiChanges, ARunOfARecordingGoesOnWhileItsPolicyServiceIsHeard) {
  store_.record(run_info());
  FakePlayback playback;
  options_.playback = &playback;
  options_.silence = -1;
  const auto state = [&] { return Api(options_, store_, &live_).runs()["runs"][0]["state"]; };
  EXPECT_EQ(state(), "lost") << "its policy_service was never heard";
  live_.policy = true;
  EXPECT_EQ(state(), "running") << "however long ago that was: the recording may stand still";
  options_.silence = 5;
  live_.policy = false;
  EXPECT_EQ(state(), "lost");
}

}  // namespace
}  // namespace citylearn::testing
