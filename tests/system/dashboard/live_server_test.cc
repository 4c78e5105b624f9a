// SPDX-License-Identifier: Apache-2.0
// The web server and WebSocket clients that behave, and that do not.
#include <map>

#include "core/util/random.h"
#include "tests/support/web/server_fixture.h"

namespace citylearn::testing {
namespace {

TEST_F(RunningServerTest, LiveNewsReachWhoWatches) {
  const auto one = watching({"scene:env@run", "events"});
  hub_.publish("scene:env@run", {{"agents", 3}}, bytes(72), Merge::kReplace);
  const auto scene = news_of(one->take());
  ASSERT_TRUE(scene);
  EXPECT_EQ(scene->header["topic"], "scene:env@run");
  EXPECT_EQ(scene->header["agents"], 3);
  EXPECT_EQ(scene->payload, 72u);
  one->say(Json{{"watch", {"runs"}}}.dump());
  EXPECT_TRUE(poll_until([&] { return watched("runs") && !watched("events"); }, WebClient::kTimeout));
  hub_.publish("events", {}, bytes(5), Merge::kEach);
  hub_.publish("runs", {}, bytes(100'000), Merge::kReplace);
  const auto runs = news_of(one->take());
  ASSERT_TRUE(runs);
  EXPECT_EQ(runs->header["topic"], "runs");
  EXPECT_EQ(runs->payload, 100'000u);
  one->say("", 8);
  EXPECT_TRUE(one->ended());
  EXPECT_TRUE(poll_until([&] { return hub_.watched().empty(); }, WebClient::kTimeout));
}

TEST_F(RunningServerTest, AClientThatStopsLosesFramesButNotTheNewest) {
  ASSERT_LT(health(), 100ms);
  const auto stopped = watching({"picture", "events", "training"}, 4096);
  const auto other = watching({"picture"});
  const std::size_t before = resident();
  int seen = 0;
  for (int i = 1; i <= 2000; ++i) {
    hub_.publish("picture", {{"i", i}}, bytes(50'000), Merge::kReplace);
    hub_.publish("events", {{"i", i}}, bytes(10'000), Merge::kEach);
    hub_.publish("training", {{"rows", 10}}, bytes(800), Merge::kAppend);
    if (i % 100 == 0)
      while (other->take(1ms)) ++seen;
  }
  EXPECT_LT(resident(), before + (32u << 20));
  EXPECT_GT(seen, 0) << "the other client is served meanwhile";
  std::map<std::string, Json> last;
  std::uint64_t frames = 0, rows = 0;
  while (const auto news = news_of(stopped->take(
             last.size() == 3 && last["picture"]["i"] == 2000 && last["events"]["i"] == 2000 ? 200ms
                                                                                             : WebClient::kTimeout))) {
    last[news->header["topic"]] = news->header;
    ++frames;
    rows += news->header.value("rows", 0u);
  }
  EXPECT_EQ(last["picture"]["i"], 2000);
  EXPECT_EQ(last["events"]["i"], 2000);
  EXPECT_GE(rows, 2000u);
  const std::uint64_t dropped =
      std::max({last["picture"]["dropped"], last["events"]["dropped"], last["training"]["dropped"]});
  EXPECT_GT(dropped, 1000u);
  EXPECT_LT(frames, 2000u);
}

TEST_F(ServerTest, AClientThatTakesNothingIsLetGo) {
  options_.ping = 50ms;
  options_.patience = 400ms;
  start();
  const auto alive = watching({"runs"});
  const auto mute = watching({"runs"});
  const auto stopped = watching({"picture"}, 4096);
  const auto begin = Clock::now();
  for (int i = 0; i < 100; ++i) hub_.publish("picture", {}, bytes(100'000), Merge::kReplace);
  EXPECT_TRUE(poll_until(
      [&] {
        alive->take(1ms);
        mute->take(1ms, true);
        hub_.publish("picture", {}, bytes(100'000), Merge::kReplace);
        return hub_.counts().clients == 1;
      },
      WebClient::kTimeout));
  EXPECT_GE(Clock::now() - begin, 350ms);
  EXPECT_GE(alive->pings, 3);
  EXPECT_EQ(metric("citylearn_dashboard_live_let_go_total"), 2);
  hub_.publish("runs", {}, bytes(1), Merge::kReplace);
  EXPECT_TRUE(news_of(alive->take())) << "who answers pings stays";
}

TEST_F(RunningServerTest, MalformedFramesEndTheirOwnConnectionOnly) {
  const auto good = watching({"services"});
  ASSERT_LT(health(), 100ms);
  const std::size_t before = resident();
  using std::string_literals::operator""s;
  const std::string mask = "\x12\x34\x56\x78";
  for (const std::string& frame : {"\x81\x05hello"s,                                    // not masked
                                   "\xF1\x80"s + mask,                                  // reserved bits
                                   "\x83\x80"s + mask,                                  // unknown opcode
                                   "\x80\x80"s + mask,                                  // goes on with nothing
                                   "\x09\x80"s + mask,                                  // a ping in parts
                                   "\x89\xFE\x00\x7E"s + mask + std::string(126, 'p'),  // a large ping
                                   "\x81\xFF\x7F\xFF\xFF\xFF\xFF\xFF\xFF\xFF"s + mask,  // of 2^63 bytes
                                   "\x81\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF"s + mask,  // of more
                                   "\x81\xFE\x00\x05"s + mask + "hello",  // a length not in its shortest form
                                   "\x88\x81"s + mask + "x",              // a close with half a code
                                   "\x81\x82"s + mask + std::string("\xFF\x12\xFE\x12", 2)}) {  // no UTF-8
    const auto one = client();
    ASSERT_EQ(one->upgrade().status, 101);
    one->send(frame);
    EXPECT_TRUE(one->ended()) << frame.size();
  }
  for (const std::string& text :
       {""s, "{}"s, "[1]"s, "{\"watch\": 1}"s, "{\"watch\": [1]}"s, "{\"watch\": [\""s + std::string(600, 't') + "\"]}",
        Json{{"watch", std::vector<std::string>(65, "t")}}.dump(), std::string(20'000, '['),
        std::string(70'000, ' ')}) {
    const auto one = client();
    ASSERT_EQ(one->upgrade().status, 101);
    one->say(text);
    const auto close = one->take();
    ASSERT_TRUE(close) << text;
    EXPECT_EQ(close->opcode, 8);
    one->say(close->payload, 8);
    EXPECT_TRUE(one->ended());
  }
  Random random(3);
  for (int round = 0; round < 200; ++round) {
    const auto one = client();
    ASSERT_EQ(one->upgrade().status, 101);
    std::string noise;
    for (std::uint64_t length = 1 + random.below(200); length > 0; --length)
      noise += static_cast<char>(random.below(256));
    one->send(noise);
  }
  EXPECT_LT(resident(), before + kMemory);
  EXPECT_LT(health(), 100ms);
  EXPECT_GE(metric("citylearn_dashboard_live_broken_total"), 10);
  hub_.publish("services", {}, bytes(1), Merge::kReplace);
  EXPECT_TRUE(news_of(good->take()));
}

}  // namespace
}  // namespace citylearn::testing
