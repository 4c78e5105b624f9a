// SPDX-License-Identifier: Apache-2.0
#include "tools/ros2/translation.h"

#include <gtest/gtest.h>

#include <regex>

namespace citylearn::testing {
namespace {

constexpr std::uint64_t kMillisecond = 1'000'000, kBegin = 1'700'000'000'000'000'000;

struct Sent {
  std::string topic, type;
  std::uint64_t time;
  Bytes data;
};

class Ros2TranslationTest : public ::testing::Test, private Ros2Sink {
 protected:
  Ros2Translation make(const Ros2Translation::Options& options) {
    return {*this,
            options,
            {[](const std::string&, std::uint64_t) { return nullptr; },
             [this](const std::string&, const PictureKey& key, bool& coming) {
               coming = coming_;
               return coming_ || key.frame == unreadable_ ? nullptr : std::make_shared<PictureFile>(picture_);
             }}};
  }
  static msg::Observation observation(std::uint64_t step, const std::string& id = "env",
                                      std::uint64_t incarnation = 7) {
    msg::Observation seen;
    seen.header().sender(id.c_str());
    seen.header().incarnation(incarnation);
    seen.settings().incarnation(5);
    seen.settings().version(1);
    seen.step(step);
    for (auto* sequence : {&seen.frame(), &seen.position(), &seen.goal()})
      sequence->assign(2, static_cast<std::uint32_t>(step));
    seen.flags({0, msg::FLAG_IDLE});
    seen.reward({1, 2});
    return seen;
  }
  static msg::Action action(std::uint64_t step) {
    msg::Action made;
    made.environment("env");
    made.environment_incarnation(7);
    made.settings(observation(step).settings());
    made.step(step);
    made.choice({kNext, kStay});
    return made;
  }
  /// Returns how many messages came on topics with this ending; all are forgotten.
  std::size_t count(const std::string& name) {
    const std::size_t found = static_cast<std::size_t>(
        std::count_if(sent_.begin(), sent_.end(), [&](const Sent& sent) { return sent.topic.ends_with("/" + name); }));
    sent_.clear();
    return found;
  }

  std::vector<Sent> sent_;
  bool coming_ = false;
  std::uint32_t unreadable_ = 1000;
  const PictureFile picture_{"image/jpeg", "picture"};

 private:
  void publish(const Ros2Message& message) override {
    sent_.push_back({message.topic, message.type->name, message.time, Bytes(message.data.begin(), message.data.end())});
  }
};

TEST_F(Ros2TranslationTest, EachIdHasANameOfRos2) {
  Ros2Translation translation = make({});
  std::set<std::string> topics;
  for (const char* id : {"env-a", "env_a", "env.a", "9", "-x", "env-a_2", "env-a"})
    translation.on_message(observation(1, id), kBegin);
  for (const Sent& sent : sent_) {
    if (!sent.topic.ends_with("/reward")) continue;
    EXPECT_TRUE(topics.insert(sent.topic).second) << sent.topic;
  }
  EXPECT_EQ(topics.size(), 6u) << "the last id was heard before";
  for (const std::string& topic : topics)
    EXPECT_TRUE(std::regex_match(topic, std::regex("/citylearn/[A-Za-z][A-Za-z0-9_]*/agent_0/reward"))) << topic;
  EXPECT_TRUE(topics.contains("/citylearn/env_a/agent_0/reward"));
}

TEST_F(Ros2TranslationTest, ObservationsAreAsOftenAsTheRateSays) {
  Ros2Translation some = make({.rate = 10}), all = make({.rate = 0});
  const auto send = [&](Ros2Translation& translation, std::uint64_t begin) {
    for (std::uint64_t step = 0; step < 100; ++step) {
      translation.on_message(observation(begin + step), kBegin + (begin + step) * 10 * kMillisecond);
      translation.on_message(observation(begin + step), kBegin + (begin + step) * 10 * kMillisecond + 1);  // again
    }
  };
  send(some, 0);
  EXPECT_EQ(count("reward"), 10u);
  send(all, 0);
  EXPECT_EQ(count("reward"), 100u);
  some.on_message(observation(100), kBegin - 1000 * kMillisecond);
  EXPECT_EQ(count("reward"), 1u) << "the clock was set back";
  some.on_message(observation(0, "env", 8), kBegin - 1000 * kMillisecond);
  EXPECT_EQ(count("reward"), 1u) << "the env_service is another process";
}

TEST_F(Ros2TranslationTest, ActionsAnswerTheObservationsThatWereSent) {
  Ros2Translation translation = make({.agents = 2, .rate = 10});
  translation.on_message(action(0), kBegin);
  EXPECT_EQ(count("cmd_vel"), 0u) << "no observation";
  translation.on_message(observation(3), kBegin);
  translation.on_message(observation(4), kBegin + kMillisecond);
  translation.on_message(action(4), kBegin + kMillisecond);
  EXPECT_EQ(count("cmd_vel"), 0u) << "that observation was not sent";
  translation.on_message(action(3), kBegin + 2 * kMillisecond);
  translation.on_message(action(3), kBegin + 3 * kMillisecond);
  ASSERT_EQ(sent_.size(), 4u) << "once for each of two agents";
  EXPECT_EQ(sent_[0].topic, "/citylearn/env/agent_0/action");
  EXPECT_EQ(sent_[0].data, (Bytes{std::byte{0}, std::byte{1}, std::byte{0}, std::byte{0}, std::byte{kNext}}));
  EXPECT_EQ(sent_[0].time, kBegin + 2 * kMillisecond);
  EXPECT_EQ(sent_[3].topic, "/citylearn/env/agent_1/cmd_vel");
}

TEST_F(Ros2TranslationTest, IdleAgentsSeeNothing) {
  Ros2Translation translation = make({.agents = 2});
  translation.on_message(observation(1), kBegin);
  for (const Sent& sent : sent_) EXPECT_TRUE(sent.topic.starts_with("/citylearn/env/agent_0/")) << sent.topic;
  EXPECT_EQ(sent_.size(), 2u) << "a reward and a picture; no map is known";
}

TEST_F(Ros2TranslationTest, ScenesDoWhereNoObservationsCome) {
  Ros2Translation translation = make({.rate = 10});
  const auto scene = [](std::uint64_t step, const char* id) {
    msg::Scene made;
    made.header() = observation(step, id).header();
    made.settings() = observation(step, id).settings();
    made.step(step);
    made.frame({static_cast<std::uint32_t>(step)});
    made.position() = made.goal() = made.frame();
    made.flags({0});
    return made;
  };
  translation.on_message(observation(1, "observed"), kBegin);
  sent_.clear();
  for (std::uint64_t step = 2; step < 12; ++step)
    for (const char* id : {"observed", "watched"})
      translation.on_message(scene(step, id), kBegin + step * 50 * kMillisecond);
  ASSERT_EQ(sent_.size(), 5u);
  for (const Sent& sent : sent_) EXPECT_EQ(sent.topic, "/citylearn/watched/agent_0/image/compressed");
}

TEST_F(Ros2TranslationTest, APictureIsSentWhenItComes) {
  Ros2Translation translation = make({.rate = 0});
  coming_ = true;
  for (std::uint64_t step = 0; step < 5; ++step)
    translation.on_message(observation(step), kBegin + step * kMillisecond);
  translation.poll();
  EXPECT_EQ(count("image/compressed"), 0u);
  coming_ = false;
  translation.poll();
  ASSERT_EQ(sent_.size(), 2u) << "the one that was waited for, and the newest";
  EXPECT_EQ(sent_[0].time, kBegin) << "when it was seen";
  EXPECT_EQ(sent_[1].time, kBegin + 4 * kMillisecond);
  EXPECT_EQ(translation.pictures(), 2u);
  sent_.clear();
  translation.poll();
  EXPECT_TRUE(sent_.empty());
  unreadable_ = 5;
  translation.on_message(observation(5), kBegin + 5 * kMillisecond);
  EXPECT_EQ(count("image/compressed"), 0u);
  EXPECT_EQ(translation.missing_pictures(), 1u);
}

}  // namespace
}  // namespace citylearn::testing
