// SPDX-License-Identifier: Apache-2.0
// A learner over a DDS stack of another make, RustDDS, at an env_service of ours, also beside our policy_service: one
// at a time, each in its turn, and every episode recorded once.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <regex>

#include "core/wire/node.h"
#include "tests/paths.h"
#include "tests/support/processes/service.h"
#include "tests/support/processes/trial.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// Returns "" when each learner had the env_service until it was idle or was taken over, by the env_service's log.
std::string intrusion(const std::string& log) {
  const std::regex settings("settings \\d+ of '([^']*)': (\\w+)"), taken("policy_service '([^']*)' takes over from");
  std::string in_charge;
  for (const std::string& line : lines_of(log)) {
    std::smatch match;
    if (std::regex_search(line, match, taken)) in_charge = match[1];
    if (!std::regex_search(line, match, settings)) continue;
    if (!in_charge.empty() && match[1] != in_charge) return line;
    in_charge = match[2] == "idle" ? "" : match[1].str();
  }
  return "";
}

class RustPeer : public VendorTest {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(FOREIGN_RUST)) GTEST_SKIP() << "the test foreign_rust_build says why there is none";
  }
  std::unique_ptr<Service> in_rust(const std::string& id, const Arguments& more = {}) {
    const Arguments command = {FOREIGN_RUST, "--domain", std::to_string(run_.domain()), "--id", id, "--record"};
    return std::make_unique<Service>(command + Arguments{run_.folder() / (id + ".csv")} + more,
                                     run_.folder() / (id + ".log"));
  }

  Trial run_{GetParam()};
};
CITYLEARN_EACH_VENDOR(RustPeer);

/// The env_service's next process has a clock that was set back by an hour.
TEST_P(RustPeer, ARestartWithTheClockSetBackIsHeard) {
  const auto env = run_.env("summer");
  const auto learner = in_rust("rust", {"--steps", "10000000"});
  Node node({run_.middleware(), "env_service", "successor", "default"});
  node.create_reader<msg::TraversalInfo>();
  node.create_reader_at<msg::TaskSettings>("env-summer");
  msg::TraversalInfo info;
  const auto spin = [&] { node.wait(Clock::now() + milliseconds(20)); };
  ASSERT_TRUE(eventually(
      spin, [&] { return node.take(info); }, kLongWait));
  ASSERT_TRUE(env->says(": training", kLongWait)) << env->output() << learner->output();
  env->end(SIGKILL, seconds(5));
  info.header().incarnation() -= 3'600'000'000;  // microseconds
  info.settings() = msg::SettingsId();
  msg::TaskSettings again;
  Clock::time_point next{};
  const auto commanded = [&] {
    if (Clock::now() >= next) {
      ++info.header().message();
      node.forward(info);
      next = Clock::now() + milliseconds(500);
    }
    return node.take(again) && again.settings().version() > 1;
  };
  EXPECT_TRUE(eventually(spin, commanded, seconds(20))) << learner->output();
}

TEST_P(RustPeer, LearnsAndRecordsEveryEpisode) {
  const auto env = run_.env("summer");
  const auto rust = in_rust("rust");
  ASSERT_EQ(rust->wait(kLongWait), 0) << rust->output() << env->output();
  double spl = 0;
  const std::string said = rust->output();
  ASSERT_EQ(std::sscanf(said.substr(said.find("SPL")).c_str(), "SPL %lf", &spl), 1) << said;
  EXPECT_GT(spl, 0.9) << said;
  ASSERT_EQ(env->end(SIGTERM, seconds(5)), 0);
  EXPECT_TRUE(contains(env->output(), "all acknowledged")) << env->output();
}

TEST_P(RustPeer, TwoAndOursAtOnceTakeTurns) {
  const auto env = run_.env("summer");
  const auto ours = run_.policy({"--mode", "evaluate", "--agent", "blind", "--evaluate", "summer", "--tasks", "100"}),
             one = in_rust("one-1"), two = in_rust("two.2");
  for (Service* learner : {ours.get(), one.get(), two.get()})
    ASSERT_EQ(learner->wait(kLongWait), 0) << learner->output() << env->output();
  ASSERT_EQ(env->end(SIGTERM, seconds(5)), 0);
  const std::string log = env->output();
  EXPECT_EQ(intrusion(log), "") << log;
  EXPECT_FALSE(contains(log, "takes over")) << log;
  EXPECT_TRUE(contains(log, "all acknowledged")) << log;
}

TEST_P(RustPeer, TwoRecordEveryEpisodeOnce) {
  const auto env = run_.env("summer");
  const auto one = in_rust("one"), two = in_rust("two");
  std::vector<std::string> episodes;
  for (Service* learner : {one.get(), two.get()})
    ASSERT_EQ(learner->wait(kLongWait), 0) << learner->output() << env->output();
  ASSERT_EQ(env->end(SIGTERM, seconds(5)), 0);
  for (const std::string id : {"one", "two"})
    for (const std::string& line : lines_of(contents(run_.folder() / (id + ".csv")))) episodes.push_back(line);
  const std::size_t lines = episodes.size();
  std::sort(episodes.begin(), episodes.end());
  EXPECT_EQ(std::unique(episodes.begin(), episodes.end()) - episodes.begin(), static_cast<std::ptrdiff_t>(lines));
  EXPECT_TRUE(contains(env->output(), "stops: " + std::to_string(lines) + " episodes, all acknowledged"))
      << lines << " recorded\n"
      << env->output();
}

TEST_P(RustPeer, OursThatSleptWaitsForTheOther) {
  const auto env = run_.env("summer");
  const auto ours = run_.train(10'000'000, "ours", {"--checkpoint-every", "1000000"});
  ASSERT_TRUE(env->says("of 'policy': training", kLongWait)) << env->output() << ours->output();
  ours->send(SIGSTOP);
  const auto rust = in_rust("rust");
  ASSERT_TRUE(env->says("policy_service 'rust' takes over from 'policy', which was last heard", kLongWait))
      << env->output();
  ours->send(SIGCONT);
  ASSERT_EQ(rust->wait(kLongWait), 0) << rust->output() << env->output();
  EXPECT_TRUE(poll_until([&] { return occurrences(env->output(), "of 'policy': training") == 2; }, kLongWait))
      << ours->output() << env->output();
  EXPECT_EQ(ours->end(SIGTERM, seconds(5)), 130) << ours->output();
  EXPECT_EQ(intrusion(env->output()), "") << env->output();
}

TEST(RustPeerAlone, HasTheGoldenBytes) {
  if (!std::filesystem::exists(FOREIGN_RUST)) GTEST_SKIP() << "the test foreign_rust_build says why there is none";
  Folder folder;
  Service rust({FOREIGN_RUST, "--golden", std::string(CITYLEARN_SOURCE_DIR) + "/tests/golden/messages.txt"},
               folder / "log");
  EXPECT_EQ(rust.wait(seconds(20)), 0) << rust.output();
  EXPECT_TRUE(contains(rust.output(), "7 messages have the golden bytes")) << rust.output();
}

}  // namespace
}  // namespace citylearn::testing
