// SPDX-License-Identifier: Apache-2.0
// Which services live, by their heartbeats.
#include <gtest/gtest.h>

#include "core/exchange/presence.h"
#include "dashboard/live/live.h"
#include "tests/support/records/records.h"
#include "tests/support/wait.h"
#include "tests/unit/dashboard/api/rows.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

/// Heartbeats with a clock of the test's own.
class Beats {
 public:
  std::vector<std::string> beat(const std::string& id, msg::State state, std::uint64_t incarnation = 7,
                                const std::string& run = "demo", const std::string& activity = "busy") {
    msg::ServiceStatus status;
    sign(status.header(), id, incarnation, 1, run);
    status.service() = "env_service";
    status.host() = "host";
    status.process() = 12;
    status.service_state() = state;
    status.activity() = activity.c_str();
    std::vector<Event> events;
    list.on_message(status, now, events);
    return kinds(events);
  }
  std::vector<std::string> after(milliseconds time) {
    now += time;
    std::vector<Event> events;
    list.poll(now, events);
    return kinds(events);
  }
  std::string state(const std::string& id, const std::string& run = "demo") const {
    const Json all = list.json(now);
    for (const Json& service : all["services"])
      if (service["id"] == id && service["session"] == run) return service["state"];
    return "none";
  }
  static std::vector<std::string> kinds(const std::vector<Event>& events) {
    std::vector<std::string> names;
    for (const Event& event : events) names.push_back(event.kind);
    return names;
  }
  ServiceList list;
  Clock::time_point now = Clock::time_point() + std::chrono::hours(1);
};

using Kinds = std::vector<std::string>;

TEST(ServiceList, AServiceThatFallsSilentIsLostAndMayComeBack) {
  Beats beats;
  EXPECT_EQ(beats.beat("env", msg::WAITING), Kinds{"started"});
  EXPECT_FALSE(beats.list.is_working("demo", "env"));
  EXPECT_EQ(beats.beat("env", msg::RUNNING), Kinds{});
  EXPECT_TRUE(beats.list.is_working("demo", "env"));
  EXPECT_FALSE(beats.list.is_working("demo", "another"));
  EXPECT_EQ(beats.state("env"), "running");
  EXPECT_EQ(beats.after(kSilence - milliseconds(1)), Kinds{});
  EXPECT_TRUE(beats.list.is_alive("demo", "env"));
  EXPECT_EQ(beats.after(milliseconds(1)), Kinds{"lost"});
  EXPECT_EQ(beats.state("env"), "lost");
  EXPECT_FALSE(beats.list.is_alive("demo", "env"));
  EXPECT_EQ(beats.after(seconds(60)), Kinds{}) << "told once";
  EXPECT_EQ(beats.beat("env", msg::RUNNING), Kinds{"back"});
  EXPECT_EQ(beats.state("env"), "running");
  beats.after(seconds(3));
  EXPECT_EQ(beats.beat("env", msg::STARTING, 8), Kinds{"restarted"});
  EXPECT_EQ(beats.state("env"), "starting");
}

TEST(ServiceList, WhoSaysThatItStopsIsNotLost) {
  Beats beats;
  beats.beat("env", msg::RUNNING);
  EXPECT_EQ(beats.beat("env", msg::STOPPING), Kinds{});
  EXPECT_EQ(beats.state("env"), "stopping");
  EXPECT_EQ(beats.after(kSilence), Kinds{"stopped"});
  EXPECT_EQ(beats.state("env"), "stopped");
  beats.beat("policy", msg::RUNNING);
  EXPECT_EQ(beats.beat("policy", msg::FAILED, 7, "demo", "no disk"), Kinds{"failed"});
  EXPECT_EQ(beats.beat("policy", msg::FAILED), Kinds{}) << "told once";
  EXPECT_EQ(beats.after(kSilence), Kinds{});
  EXPECT_EQ(beats.state("policy"), "failed");
}

TEST(ServiceList, TheFirstOfTwoProcessesIsShownWhileItLives) {
  Beats beats;
  beats.beat("env", msg::RUNNING, 7);
  EXPECT_EQ(beats.beat("env", msg::STARTING, 8), Kinds{});
  EXPECT_EQ(beats.beat("env", msg::RUNNING, 7), Kinds{});
  EXPECT_EQ(beats.state("env"), "running");
  beats.after(kSilence);
  EXPECT_EQ(beats.beat("env", msg::STARTING, 6), Kinds{"restarted"}) << "whatever its clock says";
  EXPECT_EQ(beats.state("env"), "starting");
  beats.beat("env", msg::STOPPING, 6);
  EXPECT_EQ(beats.beat("env", msg::STARTING, 9), Kinds{"restarted"}) << "at once";
}

TEST(ServiceList, AnAlarmIsAnEventWhenItBeginsChangesAndEnds) {
  Beats beats;
  beats.beat("policy", msg::RUNNING);
  const auto sound = [&](const std::string& alarm) {
    std::vector<Event> events;
    msg::ServiceStatus status;
    sign(status.header(), "policy", 7, 1, "demo");
    status.service_state() = msg::RUNNING;
    status.alarm(alarm);
    beats.list.on_message(status, beats.now, events);
    return events;
  };
  const std::vector<Event> begins = sound("checkpoint: no room");
  ASSERT_EQ(begins.size(), 1u);
  EXPECT_EQ(begins[0].kind, "alarm");
  EXPECT_EQ(begins[0].text, "checkpoint: no room");
  EXPECT_EQ(beats.list.json(beats.now)["services"][0]["alarm"], "checkpoint: no room");
  EXPECT_TRUE(sound("checkpoint: no room").empty()) << "told once";
  EXPECT_EQ(sound("store: no room").size(), 1u);
  const std::vector<Event> ends = sound("");
  ASSERT_EQ(ends.size(), 1u);
  EXPECT_EQ(ends[0].text, "resolved: store: no room");
}

TEST(ServiceList, TellsRunsApartAndForgetsInTheEnd) {
  Beats beats;
  beats.beat("env", msg::RUNNING, 7, "one");
  beats.beat("env", msg::WAITING, 7, "two", "caf\xc3");  // not UTF-8
  EXPECT_EQ(beats.state("env", "one"), "running");
  EXPECT_EQ(beats.state("env", "two"), "waiting");
  expect_row(beats.list.json(beats.now)["services"][0], "service");
  beats.after(std::chrono::minutes(61));
  EXPECT_TRUE(beats.list.json(beats.now)["services"].empty());
  for (int i = 0; i < 1100; ++i) {
    beats.after(milliseconds(1));
    beats.beat("env-" + std::to_string(i), msg::RUNNING);
  }
  EXPECT_EQ(beats.list.json(beats.now)["services"].size(), 1000u);
  EXPECT_EQ(beats.state("env-99"), "none");
  EXPECT_EQ(beats.state("env-100"), "running");
}

}  // namespace
}  // namespace citylearn::testing
