// SPDX-License-Identifier: Apache-2.0
// Pictures through all services, and what happens where some of them are missing, broken or killed.
#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "tests/support/processes/encoding_watch.h"
#include "tests/support/processes/trial.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

TEST(Encoding, AKilledEncoderServiceIsReplacedAndChangesNothing) {
  Trial run("simulated");
  const auto summer = run.env("summer", kDrawn);
  auto encoder = run.encoder({});
  constexpr int kUpdates = 300;
  const auto straight = run.train(kUpdates, "straight", {"--lockstep"});
  ASSERT_EQ(straight->wait(kLongWait), 0) << straight->output();
  const auto disturbed = run.train(kUpdates, "disturbed", {"--lockstep"});
  ASSERT_TRUE(run.has_checkpoint("disturbed", kLongWait)) << disturbed->output();
  ASSERT_EQ(encoder->end(SIGKILL, seconds(5)), 128 + SIGKILL);
  ASSERT_FALSE(disturbed->says("trained ", milliseconds(1))) << "it had finished training before";
  encoder = run.encoder({});
  ASSERT_EQ(disturbed->wait(kLongWait), 0) << disturbed->output() << encoder->output();
  EXPECT_EQ(run.checkpoint("disturbed").first, run.checkpoint("straight").first);
  EXPECT_TRUE(run.checkpoint("disturbed").second == run.checkpoint("straight").second) << "the checkpoints differ";
}

TEST(Encoding, AnotherEncoderInTheSameRunIsAMistake) {
  Trial run("simulated");
  const auto summer = run.env("summer", kDrawn);
  const auto hog = run.encoder({"--id", "hog", "--encoder", "hog"});
  ASSERT_TRUE(hog->says("serves 'env-summer'", kEncodingWait)) << hog->output();
  for (const Arguments& options :
       {Arguments{"--encoder", "patchnorm"}, Arguments{"--encoder", "hog", "--hog-bins", "9"},
        Arguments{"--encoder", "hog", "--dimension", "32"}})
    for (const std::string& store : {run.folder() / "store", std::string("none")}) {
      const auto other = run.encoder(Arguments{"--id", "other", "--store", store} + options);
      ASSERT_EQ(other->wait(kEncodingWait), 1) << other->output();
      EXPECT_TRUE(contains(other->output(), "'hog' already encodes with")) << other->output();
    }
}

TEST(Encoding, PixelsReachThePolicyServiceAsTheyAre) {
  Trial run("simulated");
  EncodingWatch watch(run.middleware());
  const auto encoder = run.encoder({"--encoder", "raw84", "--dimension", "0", "--centring", "none"});
  const auto summer = run.env("summer", {"--dataset", "synthetic", "--frames", "0:16"});
  ASSERT_TRUE(encoder->says("serves 'env-summer'", kEncodingWait)) << encoder->output();
  const std::vector<float> pixels = watch.features("summer", "encoder", kEncodingWait);
  ASSERT_EQ(pixels.size(), 16u * 84 * 84 * 3) << encoder->output();
  const auto [least, most] = std::minmax_element(pixels.begin(), pixels.end());
  EXPECT_GE(*least, 0);
  EXPECT_LT(*least, 0.1f);
  EXPECT_LE(*most, 1);
  EXPECT_GT(*most, 0.9f) << "scaled to length 1 they would be less than 0.1";
}

/// The folder of an encoder_service of its own, or none.
std::string own_store(const Trial& run, const std::string& id, bool stores) {
  return stores ? run.folder() / ("store-" + id) : "none";
}

/// The names and contents of a store's files.
std::map<std::string, std::string> stored_files(const std::string& store) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(store))
    files[entry.path().filename()] = contents(entry.path());
  return files;
}

bool serves_summer(const Service& encoder) {
  return occurrences(encoder.output(), "serves 'env-summer'") > occurrences(encoder.output(), "leaves 'env-summer'");
}

constexpr int kLongWayFrames = 320;  // five blocks
const Arguments kLongWay = {"--dataset", "synthetic", "--frames", "0:" + std::to_string(kLongWayFrames)};

TEST(EncodingShared, AnyNumberOfEncoderServicesMakeTheSameFeaturesOfEachFrameOnce) {
  std::vector<float> expected;
  std::map<std::string, std::string> expected_files;
  for (const bool stores : {false, true})
    for (const int count : {1, 2, 3}) {
      const std::string what = std::to_string(count) + (stores ? " with stores" : " without stores");
      Trial run("simulated");
      EncodingWatch watch(run.middleware());
      std::vector<std::string> ids;
      std::vector<std::unique_ptr<Service>> encoders;
      for (int i = 0; i < count; ++i) {
        ids.push_back("encoder-" + std::to_string(i));
        encoders.push_back(run.encoder({"--id", ids.back(), "--store", own_store(run, ids.back(), stores)}));
      }
      const auto summer = run.env("summer", kLongWay);
      int encoded = 0;
      for (const auto& encoder : encoders) {
        ASSERT_TRUE(encoder->says("summer: ready", kLongWait)) << what << encoder->output();
        const int own = number_before(encoder->output(), " of them now");
        EXPECT_GE(own, kLongWayFrames / count / 4) << what << ": it has its share";
        EXPECT_EQ(own + number_before(encoder->output(), " by others"), kLongWayFrames) << what << encoder->output();
        encoded += own;
      }
      EXPECT_EQ(encoded, kLongWayFrames) << what << ": each frame once";
      // Each of them serves the same: the one that does is killed, until none is left.
      while (!ids.empty()) {
        std::size_t serving = ids.size();
        ASSERT_TRUE(poll_until(
            [&] {
              for (std::size_t i = 0; i < ids.size(); ++i)
                if (serves_summer(*encoders[i])) serving = i;
              return serving < ids.size();
            },
            kEncodingWait))
            << what;
        const std::vector<float> features = watch.features("summer", ids[serving], kEncodingWait);
        ASSERT_FALSE(features.empty()) << what << encoders[serving]->output();
        if (expected.empty()) expected = features;
        EXPECT_TRUE(features == expected) << what << ", " << ids[serving];
        if (stores) {
          const auto files = stored_files(own_store(run, ids[serving], stores));
          if (expected_files.empty()) expected_files = files;
          EXPECT_EQ(files.size(), 4u) << "descriptors, features, the encoder's words, the reduction";
          EXPECT_TRUE(files == expected_files) << what << ", " << ids[serving];
        }
        encoders[serving]->send(SIGKILL);
        encoders.erase(encoders.begin() + static_cast<std::ptrdiff_t>(serving));
        ids.erase(ids.begin() + static_cast<std::ptrdiff_t>(serving));
      }
    }
}

/// Writes a route of tiny pictures, the same under every name. Returns the options of env_services on such routes.
Arguments tiny_route(const Trial& run, const std::string& name, int frames = 30) {
  const std::string route = run.folder() / ("data/" + name);
  std::filesystem::create_directories(route);
  for (int i = 0; i < frames; ++i) {
    std::ofstream out(fmt::format("{}/{:03}.ppm", route, i), std::ios::binary);
    out << "P6 8 8 255\n";
    for (int k = 0; k < 8 * 8 * 3; ++k) out.put(static_cast<char>((k * (i + 3)) % 251));
  }
  return {"--dataset", "plain", "--data", run.folder() / "data"};
}

TEST(EncodingNames, RecordingsOfEqualContentsAreServedUnderEachName) {
  std::vector<float> expected;
  const std::vector<std::vector<std::string>> orders = {{"summer"},
                                                        {"winter", "summer"},
                                                        {"summer", "winter"},
                                                        {"winter", "autumn", "summer"},
                                                        {"winter", "summer", "summer"}};
  for (const std::string encoder_name : {"patchnorm", "vlad"})  // the latter learns on the reference, too
    for (const auto& order : orders) {
      const std::string what = encoder_name + " " + joined(order);
      Trial run("simulated");
      EncodingWatch watch(run.middleware());
      const auto encoder = run.encoder({"--encoder", encoder_name, "--dimension", "4", "--store", "none"});
      std::vector<std::unique_ptr<Service>> envs;
      for (std::size_t i = 0; i < order.size(); ++i) {
        Arguments options = tiny_route(run, order[i]);
        options.insert(options.end(), {"--id", fmt::format("env-{}", i)});
        envs.push_back(run.env(order[i], options));
        const auto begin = order.begin(), here = begin + static_cast<std::ptrdiff_t>(i);
        if (std::find(begin, here, order[i]) == here) {  // its name is new: it is found before the next one comes
          ASSERT_TRUE(encoder->says(fmt::format("from 'env-{}'", i), kEncodingWait)) << what << encoder->output();
        }
      }
      for (std::size_t i = 0; i < order.size(); ++i)
        ASSERT_TRUE(encoder->says(fmt::format("serves 'env-{}'", i), kEncodingWait)) << what << encoder->output();
      for (const std::string& name : order) {
        const std::vector<float> features = watch.features(name, "encoder", kEncodingWait);
        ASSERT_FALSE(features.empty()) << what << ", " << name;
        if (order.size() == 1) expected = features;
        EXPECT_TRUE(features == expected) << what << ", " << name;
      }
    }
}

TEST(EncodingNames, AnAgentIsTriedOnARecordingOfEqualContents) {
  Trial run("simulated");
  const auto summer = run.env("summer", tiny_route(run, "summer"));
  const auto encoder = run.encoder({"--encoder", "patchnorm", "--dimension", "4"});
  const auto policy = run.train(4, "out", {"--train", "summer", "--evaluate", "summer,winter", "--frames", "0:30"});
  ASSERT_TRUE(policy->says("training place_filter", kEncodingWait)) << policy->output() << encoder->output();
  const auto winter = run.env("winter", tiny_route(run, "winter"));  // the manifest names one that comes late, too
  ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output() << encoder->output();
  const Json traversals = Json::parse(contents(run.folder() / "out/manifest.json"))["traversals"];
  ASSERT_EQ(traversals.size(), 2u) << traversals;
  EXPECT_EQ(traversals["summer"], traversals["winter"]);
}

TEST(EncodingNames, OtherFramesUnderTheReferencesNameAreNamed) {
  Trial run("simulated");
  Arguments options = tiny_route(run, "summer");
  auto summer = run.env("summer", options);
  const auto encoder = run.encoder({"--encoder", "patchnorm", "--dimension", "4"});
  ASSERT_TRUE(encoder->says("serves 'env-summer'", kEncodingWait)) << encoder->output();
  EXPECT_FALSE(contains(encoder->output(), "hosts other frames"));
  ASSERT_EQ(summer->end(SIGTERM, seconds(5)), 0);
  options.insert(options.end(), {"--frames", "0:20"});
  summer = run.env("summer", options);
  ASSERT_TRUE(encoder->says("'env-summer' hosts other frames of the reference 'summer'", kEncodingWait))
      << encoder->output();
  EXPECT_TRUE(poll_until([&] { return occurrences(encoder->output(), "serves 'env-summer'") == 2; }, kEncodingWait));
}

TEST(EncodingFaults, ABrokenPictureIsNamedAndRefusedOrReplaced) {
  Trial run("simulated");
  // One of the pictures passes for a PPM file until it is decoded.
  const Arguments options = tiny_route(run, "summer");
  std::filesystem::resize_file(run.folder() / "data/summer/007.ppm", 60);
  const auto summer = run.env("summer", options);
  const auto strict = run.encoder({"--dimension", "8"});
  ASSERT_TRUE(strict->says("summer is refused", kEncodingWait)) << strict->output() << summer->output();
  EXPECT_TRUE(contains(strict->output(), "007.ppm"));
  const auto policy = run.policy({"--wait", std::to_string(3 * kSlowness)});
  ASSERT_EQ(policy->wait(kEncodingWait), 1) << policy->output();
  EXPECT_TRUE(contains(policy->output(), "summer is refused: frame 7"));
  ASSERT_EQ(strict->end(SIGTERM, seconds(5)), 0);
  const auto lenient = run.encoder({"--dimension", "8", "--on-bad-frame", "skip"});
  EXPECT_TRUE(lenient->says("serves 'env-summer'", kEncodingWait)) << lenient->output();
  // Another one fetches what can be encoded, and sees for itself what cannot.
  const auto second = run.encoder({"--id", "second", "--dimension", "8", "--on-bad-frame", "skip", "--store", "none"});
  EXPECT_TRUE(second->says("summer: ready", kEncodingWait)) << second->output();
  EXPECT_TRUE(contains(second->output(), "(0 of them now, 29 by others")) << second->output();
  EXPECT_TRUE(contains(second->output(), "007.ppm")) << second->output();
}

TEST(EncodingFaults, DefaultsFitAShortRouteAndGivenValuesMustFit) {
  Trial run("simulated");
  const auto summer = run.env("summer", {"--dataset", "synthetic", "--frames", "0:20"});
  const auto strict = run.encoder({"--dimension", "64"});
  ASSERT_EQ(strict->wait(kEncodingWait), 1) << strict->output();
  EXPECT_TRUE(contains(strict->output(), "dimension: is 64 (0 to 19: the reference has 20 frames")) << strict->output();
  const auto encoder = run.encoder({});
  ASSERT_TRUE(encoder->says("serves 'env-summer'", kEncodingWait)) << encoder->output();
  EXPECT_TRUE(contains(encoder->output(), "--dimension is 19 instead of 64")) << encoder->output();
  const auto too_long = run.policy({"--frames", "0:128", "--wait", std::to_string(3 * kSlowness)});
  ASSERT_EQ(too_long->wait(kEncodingWait), 1) << too_long->output();
  EXPECT_TRUE(contains(too_long->output(), "has 20 frames, the route needs frames 0..127")) << too_long->output();
  for (const Arguments& mode :
       {Arguments{"--steps", "1024", "--curriculum"}, Arguments{"--mode", "evaluate", "--agent", "blind"}}) {
    const Arguments options = {"--tasks", "8", "--evaluate", "summer", "--output", run.folder() / mode[1]};
    const auto policy = run.policy(options + mode);
    ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
    EXPECT_TRUE(contains(policy->output(), "'summer' has 20 frames: --frames is 0:20")) << mode[0];
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
  ASSERT_EQ(policy->wait(kEncodingWait), 1) << policy->output() << encoder->output();
  EXPECT_TRUE(contains(policy->output(), "summer waits for an env_service on the reference 'spring'"));
}

TEST(EncodingFaults, WithoutAnEncoderServiceThePolicyServiceSaysWhatIsMissing) {
  Trial run("simulated");
  const auto summer = run.env("summer", kDrawn);
  const auto policy = run.policy({"--wait", std::to_string(3 * kSlowness)});
  ASSERT_EQ(policy->wait(kEncodingWait), 1) << policy->output();
  EXPECT_TRUE(contains(policy->output(), "whose images wait for an encoder_service"));
}

}  // namespace
}  // namespace citylearn::testing
