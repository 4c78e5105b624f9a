// SPDX-License-Identifier: Apache-2.0
// Pictures through all services, and what happens where some of them are missing, broken or killed.
#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/processes/trial.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

constexpr seconds kSoon{30};

TEST(Encoding, AKilledEncoderServiceIsReplacedAndChangesNothing) {
  Trial run("simulated");
  const auto summer = run.env("summer", kDrawn);
  auto encoder = run.encoder({});
  constexpr int kUpdates = 300;
  const auto straight = run.train(kUpdates, "straight", {"--lockstep"});
  ASSERT_EQ(straight->wait(kLong), 0) << straight->output();
  const auto disturbed = run.train(kUpdates, "disturbed", {"--lockstep"});
  ASSERT_TRUE(run.has_checkpoint("disturbed", kLong)) << disturbed->output();
  ASSERT_EQ(encoder->end(SIGKILL, seconds(5)), 128 + SIGKILL);
  ASSERT_FALSE(disturbed->says("trained ", milliseconds(1))) << "it had finished training before";
  encoder = run.encoder({});
  ASSERT_EQ(disturbed->wait(kLong), 0) << disturbed->output() << encoder->output();
  EXPECT_EQ(run.checkpoint("disturbed").first, run.checkpoint("straight").first);
  EXPECT_TRUE(run.checkpoint("disturbed").second == run.checkpoint("straight").second) << "the checkpoints differ";
}

TEST(Encoding, AnotherEncoderInTheSameRunIsAMistake) {
  Trial run("simulated");
  const auto summer = run.env("summer", kDrawn);
  const auto hog = run.encoder({"--id", "hog", "--encoder", "hog"});
  ASSERT_TRUE(hog->says("serves 'env-summer'", kSoon)) << hog->output();
  const auto other = run.encoder({"--id", "other", "--encoder", "patchnorm"});
  ASSERT_EQ(other->wait(kSoon), 1) << other->output();
  EXPECT_TRUE(contains(other->output(), "'hog' already encodes with"));
}

TEST(EncodingFaults, ABrokenPictureIsNamedAndRefusedOrReplaced) {
  Trial run("simulated");
  // A route of 30 tiny pictures; one of them passes for a PNG file until it is decoded.
  const std::string route = run.folder() / "data/summer";
  std::filesystem::create_directories(route);
  for (int i = 0; i < 30; ++i) {
    std::ofstream out(fmt::format("{}/{:03}.ppm", route, i), std::ios::binary);
    out << "P6 8 8 255\n";
    for (int k = 0; k < 8 * 8 * 3; ++k) out.put(static_cast<char>((k * (i + 3)) % 251));
  }
  std::filesystem::resize_file(route + "/007.ppm", 60);
  const auto summer = run.env("summer", {"--dataset", "plain", "--data", run.folder() / "data"});
  const auto strict = run.encoder({"--dimension", "8"});
  ASSERT_TRUE(strict->says("summer is refused", kSoon)) << strict->output() << summer->output();
  EXPECT_TRUE(contains(strict->output(), "007.ppm"));
  const auto policy = run.policy({"--wait", std::to_string(3 * kSlowness)});
  ASSERT_EQ(policy->wait(kSoon), 1) << policy->output();
  EXPECT_TRUE(contains(policy->output(), "summer is refused: frame 7"));
  ASSERT_EQ(strict->end(SIGTERM, seconds(5)), 0);
  const auto lenient = run.encoder({"--dimension", "8", "--on-bad-frame", "skip"});
  EXPECT_TRUE(lenient->says("serves 'env-summer'", kSoon)) << lenient->output();
}

TEST(EncodingFaults, DefaultsFitAShortRouteAndGivenValuesMustFit) {
  Trial run("simulated");
  const auto summer = run.env("summer", {"--dataset", "synthetic", "--frames", "0:20"});
  const auto strict = run.encoder({"--dimension", "64"});
  ASSERT_EQ(strict->wait(kSoon), 1) << strict->output();
  EXPECT_TRUE(contains(strict->output(), "dimension: is 64 (0 to 19: the reference has 20 frames")) << strict->output();
  const auto encoder = run.encoder({});
  ASSERT_TRUE(encoder->says("serves 'env-summer'", kSoon)) << encoder->output();
  EXPECT_TRUE(contains(encoder->output(), "--dimension is 19 instead of 64")) << encoder->output();
  const auto too_long = run.policy({"--frames", "128", "--wait", std::to_string(3 * kSlowness)});
  ASSERT_EQ(too_long->wait(kSoon), 1) << too_long->output();
  EXPECT_TRUE(contains(too_long->output(), "has 20 frames, the route needs frames 0..127")) << too_long->output();
  for (const Arguments& mode :
       {Arguments{"--steps", "1024", "--curriculum"}, Arguments{"--mode", "evaluate", "--agent", "blind"}}) {
    Arguments options = {"--tasks", "8", "--evaluate", "summer", "--output", run.folder() / mode[1]};
    options.insert(options.end(), mode.begin(), mode.end());
    const auto policy = run.policy(options);
    ASSERT_EQ(policy->wait(kLong), 0) << policy->output();
    EXPECT_TRUE(contains(policy->output(), "'summer' has 20 frames: --frames is 20 instead of 128")) << mode[0];
  }
  const Json manifest = Json::parse(contents(run.folder() / "1024/manifest.json"));
  EXPECT_EQ(manifest["frames"], 20);
  EXPECT_EQ(manifest["max_steps"], 20);
}

TEST(EncodingFaults, AReferenceThatNobodyHostsIsNamed) {
  Trial run("simulated");
  const auto summer = run.env("summer", kDrawn);
  const auto encoder = run.encoder({"--reference", "spring"});
  const auto policy = run.policy({"--wait", std::to_string(4 * kSlowness)});
  ASSERT_EQ(policy->wait(kSoon), 1) << policy->output() << encoder->output();
  EXPECT_TRUE(contains(policy->output(), "summer waits for an env_service on the reference 'spring'"));
}

TEST(EncodingFaults, AWireThatLosesRepeatsAndReordersOnlyCostsTime) {
  Trial run("lossy:simulated");
  const auto summer = run.env("summer", kDrawn);
  const auto encoder = run.encoder({});
  const auto policy = run.train(10, "out");
  ASSERT_EQ(policy->wait(kLong), 0) << policy->output() << encoder->output();
}

TEST(EncodingFaults, WithoutAnEncoderServiceThePolicyServiceSaysWhatIsMissing) {
  Trial run("simulated");
  const auto summer = run.env("summer", kDrawn);
  const auto policy = run.policy({"--wait", std::to_string(3 * kSlowness)});
  ASSERT_EQ(policy->wait(kSoon), 1) << policy->output();
  EXPECT_TRUE(contains(policy->output(), "whose images wait for an encoder_service"));
}

}  // namespace
}  // namespace citylearn::testing
