// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/client_hub.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <thread>

#include "core/util/error.h"
#include "dashboard/live/runs_feed.h"
#include "tests/support/processes/service.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;
using Merge = Hub::Merge;

std::vector<std::byte> bytes(const std::string& text) {
  std::vector<std::byte> out(text.size());
  std::memcpy(out.data(), text.data(), text.size());
  return out;
}

std::string text(const std::vector<std::byte>& payload) {
  return {reinterpret_cast<const char*>(payload.data()), payload.size()};
}

/// A frame taken apart as docs/reference/dashboard-api.md says.
struct News {
  Json header;
  std::string payload;
};

std::optional<News> take(ClientHub::Client& client) {
  const auto frame = client.next();
  if (!frame) return std::nullopt;
  std::uint32_t length = 0;
  std::memcpy(&length, frame->head.data(), 4);
  EXPECT_EQ(frame->head.size(), 4 + length);
  EXPECT_EQ(frame->head.size() % 8, 0u);
  return News{Json::parse(frame->head.substr(4)), text(*frame->payload)};
}

/// Rows of two bytes: "0a0b" is two rows.
void append(ClientHub& hub, const std::string& rows, const Json& columns = {"x", "y"}) {
  hub.publish("training:1", {{"rows", rows.size() / 2}, {"columns", columns}}, bytes(rows), Merge::kAppend);
}

class ClientHubTest : public ::testing::Test {
 protected:
  ClientHub hub_{{.rows = 4, .each = 3, .bytes = 1000, .linger = milliseconds(0)}};
  int woken_ = 0;
  std::shared_ptr<ClientHub::Client> client_ = hub_.join([this] { ++woken_; });
};

TEST_F(ClientHubTest, NothingIsDoneForTopicsThatNobodyWatches) {
  hub_.publish("services", {}, bytes("1"), Merge::kReplace);
  EXPECT_EQ(hub_.counts().published, 0u);
  EXPECT_TRUE(hub_.watched().empty());
  client_->watch({"services", "runs"});
  EXPECT_EQ(hub_.watched(), (std::vector<std::string>{"runs", "services"}));
  EXPECT_FALSE(take(*client_));
}

TEST_F(ClientHubTest, FramesCarryTopicSequenceAndWhatThePublisherSays) {
  client_->watch({"scene:env@run"});
  for (const std::string payload : {"first", "second"}) {
    hub_.publish("scene:env@run", {{"agents", 2}, {"hash", "00ff"}}, bytes(payload), Merge::kReplace);
    const auto news = take(*client_);
    ASSERT_TRUE(news);
    EXPECT_EQ(news->payload, payload);
    EXPECT_EQ(news->header["topic"], "scene:env@run");
    EXPECT_EQ(news->header["sequence"], payload == "first" ? 1 : 2);
    EXPECT_EQ(news->header["dropped"], 0);
    EXPECT_EQ(news->header["agents"], 2);
    EXPECT_EQ(news->header["hash"], "00ff");
  }
}

TEST_F(ClientHubTest, OfAStateOnlyTheNewestIsKept) {
  client_->watch({"services"});
  for (int i = 0; i < 10; ++i) hub_.publish("services", {}, bytes(std::to_string(i)), Merge::kReplace);
  const auto news = take(*client_);
  ASSERT_TRUE(news);
  EXPECT_EQ(news->payload, "9");
  EXPECT_EQ(news->header["sequence"], 10);
  EXPECT_EQ(news->header["dropped"], 9);
  EXPECT_FALSE(take(*client_));
}

TEST_F(ClientHubTest, AnEventIsAFrameOfItsOwnAndTheOldestGo) {
  client_->watch({"events", "services"});
  for (int i = 0; i < 5; ++i) hub_.publish("events", {}, bytes(std::to_string(i)), Merge::kEach);
  hub_.publish("services", {}, bytes("s"), Merge::kReplace);
  std::string order;
  int dropped = 0;
  while (const auto news = take(*client_)) {
    order += news->payload;
    dropped = news->header["dropped"];
  }
  EXPECT_EQ(order, "2s34") << "topics take turns";
  EXPECT_EQ(dropped, 2);
}

TEST_F(ClientHubTest, RowsAreJoinedAndTheOldestGo) {
  client_->watch({"training:1"});
  append(hub_, "0a0b0c");
  append(hub_, "0d0e0f");
  auto news = take(*client_);
  ASSERT_TRUE(news);
  EXPECT_EQ(news->payload, "0c0d0e0f");
  EXPECT_EQ(news->header["rows"], 4);
  EXPECT_EQ(news->header["dropped"], 2);
  EXPECT_EQ(news->header["columns"], Json({"x", "y"}));
  append(hub_, "1a1b1c1d1e");  // more in one message than may wait
  append(hub_, "1f");
  news = take(*client_);
  ASSERT_TRUE(news);
  EXPECT_EQ(news->payload, "1c1d1e1f");
  EXPECT_EQ(news->header["dropped"], 4);
}

TEST_F(ClientHubTest, RowsOfOtherColumnsAreNotJoined) {
  client_->watch({"training:1"});
  append(hub_, "0a0b");
  append(hub_, "1a", {"x", "z"});
  const auto news = take(*client_);
  ASSERT_TRUE(news);
  EXPECT_EQ(news->payload, "1a");
  EXPECT_EQ(news->header["columns"], Json({"x", "z"}));
  EXPECT_EQ(news->header["dropped"], 2);
}

TEST_F(ClientHubTest, BeyondItsBytesAClientLosesWhatWaitsLongestButNeverAState) {
  client_->watch({"events", "training:1", "services"});
  hub_.publish("services", {}, bytes(std::string(5000, 's')), Merge::kReplace);
  hub_.publish("events", {}, bytes(std::string(600, 'a')), Merge::kEach);
  append(hub_, std::string(600, 'b'), {"x"});
  EXPECT_EQ(take(*client_)->payload.size(), 5000u);
  hub_.publish("events", {}, bytes(std::string(3000, 'c')), Merge::kEach);  // alone it may be larger
  const auto news = take(*client_);
  ASSERT_TRUE(news);
  EXPECT_EQ(news->payload, std::string(3000, 'c'));
  EXPECT_FALSE(take(*client_));
}

TEST_F(ClientHubTest, WakesOnceForAllThatComesWhileItSleeps) {
  client_->watch({"services", "events"});
  hub_.publish("services", {}, {}, Merge::kReplace);
  hub_.publish("services", {}, {}, Merge::kReplace);
  hub_.publish("events", {}, {}, Merge::kEach);
  EXPECT_EQ(woken_, 1);
  while (take(*client_)) {
  }
  hub_.publish("services", {}, {}, Merge::kReplace);
  EXPECT_EQ(woken_, 2);
}

TEST_F(ClientHubTest, ANewcomerGetsTheStateThatOthersWatch) {
  client_->watch({"services", "events"});
  hub_.publish("services", {}, bytes("now"), Merge::kReplace);
  hub_.publish("events", {}, bytes("past"), Merge::kEach);
  const auto other = hub_.join([] {});
  other->watch({"services", "events"});
  const auto news = take(*other);
  ASSERT_TRUE(news);
  EXPECT_EQ(news->payload, "now");
  EXPECT_EQ(news->header["dropped"], 0);
  EXPECT_FALSE(take(*other)) << "events of the past are no news";
}

TEST_F(ClientHubTest, ForgetsWhatIsNoLongerWatched) {
  client_->watch({"services", "runs"});
  hub_.publish("services", {}, bytes("s"), Merge::kReplace);
  hub_.publish("runs", {}, bytes("r"), Merge::kReplace);
  client_->watch({"runs"});
  EXPECT_EQ(take(*client_)->payload, "r");
  EXPECT_FALSE(take(*client_));
  EXPECT_EQ(hub_.watched(), std::vector<std::string>{"runs"});
  client_.reset();
  EXPECT_TRUE(hub_.watched().empty());
  EXPECT_EQ(hub_.counts().clients, 0u);
}

TEST_F(ClientHubTest, RefusesRowsThatAreNoneAndTwoWaysOfMerging) {
  client_->watch({"training:1"});
  EXPECT_THROW(hub_.publish("training:1", {}, bytes("0a"), Merge::kAppend), Error);
  EXPECT_THROW(hub_.publish("training:1", {{"rows", 2}}, bytes("0a0"), Merge::kAppend), Error);
  append(hub_, "0a");
  EXPECT_THROW(hub_.publish("training:1", {}, bytes("0a"), Merge::kEach), Error);
  EXPECT_EQ(take(*client_)->payload, "0a");
}

TEST_F(ClientHubTest, TextThatIsNoUtf8DoesNoHarm) {
  client_->watch({"services"});
  hub_.publish("services", {{"name", "\xff\xfe"}}, {}, Merge::kReplace);
  EXPECT_TRUE(take(*client_));
}

TEST(ClientHubLinger, WhoComesBackSoonGetsWhatHappenedMeanwhile) {
  ClientHub hub({.linger = std::chrono::minutes(1)});
  auto client = hub.join([] {});
  client->watch({"services", "runs"});
  hub.publish("services", {}, bytes("before"), Merge::kReplace);
  client.reset();
  EXPECT_EQ(hub.watched(), std::vector<std::string>{"services"}) << "of runs there was no news";
  hub.publish("services", {}, bytes("meanwhile"), Merge::kReplace);
  client = hub.join([] {});
  client->watch({"services"});
  EXPECT_EQ(take(*client)->payload, "meanwhile");
  client->watch({});
  EXPECT_EQ(hub.watched(), std::vector<std::string>{"services"});
}

TEST(ClientHubLinger, ButNotForEver) {
  ClientHub hub({.linger = milliseconds(20)});
  const auto client = hub.join([] {});
  client->watch({"services"});
  hub.publish("services", {}, bytes("s"), Merge::kReplace);
  client->watch({});
  EXPECT_TRUE(poll_until([&] { return hub.watched().empty(); }, kMaxWait));
  client->watch({"services"});
  EXPECT_FALSE(take(*client));
}

/// Four publish, four take: what was published was either taken or counted as lost.
TEST(ClientHubThreads, NothingIsLostUncounted) {
  ClientHub hub({.rows = 50, .each = 5, .bytes = 1 << 20, .linger = milliseconds(0)});
  constexpr int kMessages = 2000;
  std::atomic<int> publishing{4};
  std::vector<std::thread> threads;
  std::atomic<std::uint64_t> got{0}, lost{0};
  std::vector<std::shared_ptr<ClientHub::Client>> clients;
  for (int i = 0; i < 4; ++i) {
    clients.push_back(hub.join([] {}));
    clients.back()->watch({"events", "training:1"});
  }
  for (const auto& client : clients)
    threads.emplace_back([&, client] {
      std::uint64_t last = 0;
      for (bool more = true; more;) {
        more = publishing > 0;
        while (const auto news = take(*client)) {
          got += news->header.value("rows", 1u);
          last = news->header["dropped"];
          more = true;
        }
      }
      lost += last;
    });
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&, i] {
      for (int k = 0; k < kMessages; ++k)
        if (i % 2)
          append(hub, "0a");
        else
          hub.publish("events", {}, bytes("e"), Merge::kEach);
      --publishing;
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(hub.counts().published, 4u * kMessages);
  EXPECT_EQ(got + hub.counts().dropped, 4u * 4u * kMessages);
  EXPECT_LE(lost, hub.counts().dropped);
}

TEST(RunsFeedTest, SendsTheListToWhoWatchesItAndWhenItChanges) {
  ClientHub hub;
  std::atomic<int> asked{0}, version{1};
  const RunsFeed feed(
      hub,
      [&] {
        ++asked;
        if (version == 2) throw Error("the disk is gone", "store");
        return Json{{"runs", {version.load()}}};
      },
      milliseconds(1));
  const auto client = hub.join([] {});
  const auto awaited = [&](int count) { return poll_until([&] { return asked >= count; }, kMaxWait); };
  const auto newest = [&](int wanted) {
    std::optional<News> news;
    return poll_until(
        [&] {
          news = take(*client);
          return news && Json::parse(news->payload)["runs"][0] == wanted;
        },
        kMaxWait);
  };
  EXPECT_EQ(asked, 0) << "nobody watches";
  client->watch({"runs"});
  EXPECT_TRUE(newest(1));
  EXPECT_TRUE(awaited(asked + 3));
  EXPECT_FALSE(take(*client)) << "nothing has changed";
  version = 2;
  EXPECT_TRUE(awaited(asked + 3));
  version = 3;
  EXPECT_TRUE(newest(3));
  client->watch({});
  client->watch({"runs"});
  EXPECT_TRUE(newest(3)) << "who begins to watch gets the list";
}

}  // namespace
}  // namespace citylearn::testing
