// SPDX-License-Identifier: Apache-2.0
// Pictures through all services: real processes over loopback DDS.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/support/processes/encoding_watch.h"
#include "tests/support/processes/trial.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

class Encoding : public VendorTest {};
CITYLEARN_EACH_VENDOR(Encoding);

TEST_P(Encoding, APolicyServiceCannotTellPicturesFromFeatures) {
  Trial run(GetParam());
  const auto summer = run.env("summer", kDrawn), fall = run.env("fall", kDrawn);
  const auto encoder = run.encoder({});
  const auto policy = run.policy({"--agent", "place_filter", "--steps", "16384", "--output", run.folder() / "out",
                                  "--tasks", "300", "--evaluate", "summer,fall", "--controls", "all"});
  ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output() << encoder->output();
  const Json summary = Json::parse(contents(run.folder() / "out/summary.json"));
  EXPECT_GT(summary["evaluate"]["summer"]["spl"], 0.9);
  EXPECT_EQ(summary["controls"]["shortest_path"]["fall"]["spl"], 1.0);
  EXPECT_GT(summary["controls"]["sequence_filter"]["fall"]["spl"], 0.9) << "fall is recognised";
  // What was encoded is kept: the next encoder_service needs no picture.
  EXPECT_EQ(encoder->end(SIGTERM, seconds(5)), 0) << encoder->output();
  EXPECT_TRUE(encoder->says("256 frames encoded", seconds(1))) << encoder->output();
  const auto second = run.encoder({});
  ASSERT_TRUE(second->says("summer: ready", kEncodingWait)) << second->output();
  ASSERT_TRUE(second->says("fall: ready", kEncodingWait)) << second->output();
  ASSERT_EQ(second->end(SIGTERM, seconds(5)), 0);
  EXPECT_TRUE(second->says(" 0 frames encoded", seconds(1))) << second->output();
}

TEST_P(Encoding, RawPicturesOfSixteenAgentsAreSeenByReference) {
  Trial run(GetParam());
  // 16 x 21,168 numbers: more than an observation can hold.
  const auto summer = run.env("summer", {"--dataset", "synthetic", "--frames", "0:32", "--agents", "16"});
  auto encoder = run.encoder({"--encoder", "raw84", "--dimension", "0"});
  const Arguments task = {"--frames", "0:32", "--tasks", "64", "--evaluate", "summer"};
  const auto with = [&](const Arguments& more, const std::string& output) {
    return run.policy(more + task + Arguments{"--output", run.folder() / output});
  };
  const auto filter = with({"--mode", "evaluate", "--agent", "sequence_filter"}, "filter");
  ASSERT_EQ(filter->wait(kLongWait), 0) << filter->output() << encoder->output();
  const Json seen = Json::parse(contents(run.folder() / "filter/summary.json"))["evaluate"]["summer"];
  EXPECT_EQ(seen["completed"], 1.0);
  EXPECT_GT(seen["spl"], 0.95);
  const auto whole =
      with({"--mode", "evaluate", "--agent", "blind", "--observations", "whole", "--wait", "3"}, "whole");
  EXPECT_EQ(whole->wait(kLongWait), 1) << whole->output();
  EXPECT_TRUE(contains(whole->output(), "16 agents x 21168 do not fit one observation"));
  // In the middle of a training the encoder_service is killed: the features are here, nobody misses it.
  const auto training = with({"--agent", "place_filter", "--steps", "8192", "--checkpoint-every", "1"}, "out");
  ASSERT_TRUE(run.has_checkpoint("out", kLongWait)) << training->output();
  encoder->send(SIGKILL);
  ASSERT_EQ(training->wait(kLongWait), 0) << training->output();
  EXPECT_EQ(Json::parse(contents(run.folder() / "out/summary.json"))["train"]["steps"], 8192);
}

// These two are not in simulation, which encodes in no time.

void expect_two_to_share_the_work(const std::string& middleware, bool common_store) {
  Trial run(middleware);
  const Arguments drawn = {"--dataset", "synthetic", "--frames", "0:640"};
  const auto start = [&](const std::string& id) {
    return run.encoder({"--id", id, "--store", common_store ? std::string(run.folder() / "store") : "none"});
  };
  const auto one = start("one"), two = start("two");
  for (const auto* encoder : {one.get(), two.get()})
    ASSERT_TRUE(encoder->says("takes part", kEncodingWait)) << encoder->output();
  const auto summer = run.env("summer", drawn);
  const auto policy = run.train(600, "out");
  ASSERT_TRUE(run.has_checkpoint("out", kLongWait)) << policy->output() << one->output() << two->output();
  // The one that serves goes; the other one has all it needs.
  const auto serves = [](const Service& encoder) {
    return occurrences(encoder.output(), "serves 'env-summer'") > occurrences(encoder.output(), "leaves 'env-summer'");
  };
  ASSERT_TRUE(poll_until([&] { return serves(*one) != serves(*two); }, kEncodingWait))
      << one->output() << two->output();
  const auto& serving = serves(*one) ? one : two;
  const auto& other = serves(*one) ? two : one;
  ASSERT_TRUE(other->says("summer: ready", kEncodingWait)) << other->output();
  ASSERT_EQ(serving->end(SIGKILL, seconds(5)), 128 + SIGKILL);
  ASSERT_TRUE(poll_until([&] { return serves(*other); }, kEncodingWait)) << other->output();
  ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output() << other->output();
  const int by_serving = number_before(serving->output(), " of them now"),
            by_other = number_before(other->output(), " of them now");
  EXPECT_EQ(by_serving + by_other, 640) << "each frame once: " << by_serving << " + " << by_other;
  EXPECT_GT(std::min(by_serving, by_other), 100) << "both have a share";
  EXPECT_EQ(number_before(other->output(), " by others"), common_store ? 0 : by_serving);
}

TEST(EncodingInParts, TwoWithACommonStoreShareTheWorkAndOneTakesOver) {
  expect_two_to_share_the_work("cyclonedds", true);
}

TEST_P(Encoding, TwoWithoutAStoreShareTheWorkAndOneTakesOver) { expect_two_to_share_the_work(GetParam(), false); }

TEST(EncodingInParts, APythonFunctionKilledInTheMiddleEncodesNoneTwice) {
  ::setenv("CITYLEARN_PYTHON", "/usr/bin/python3", 1);
  Trial run("cyclonedds");
  const std::string file = run.folder() / "encoder.py", log = file + ".log";
  make_file(file, contents(CITYLEARN_SOURCE_DIR "/tests/support/encoder.py"));
  make_file(log, "");
  int process = 0;
  const auto encoded = [&] {  // pictures that the function got
    std::istringstream in(contents(log));
    int all = 0;
    for (int size = 0; in >> process >> size;) all += size;
    return all;
  };
  constexpr int kTrial = 1 + 1 + 2, kBatch = 16, kFrames = 640;
  const auto summer = run.env("summer", {"--dataset", "synthetic", "--frames", "0:640"});
  auto encoder = run.encoder({"--encoder", file});
  ASSERT_TRUE(poll_until([&] { return encoded() >= kTrial + 6 * 64 + 2 * kBatch; }, kLongWait)) << encoder->output();
  ASSERT_EQ(encoder->end(SIGKILL, seconds(5)), 128 + SIGKILL);
  const std::string command = "/proc/" + std::to_string(process) + "/cmdline";
  EXPECT_TRUE(poll_until([&] { return contents(command).empty(); }, kShortWait)) << "the function lives on";
  const int first = encoded();
  ASSERT_LT(first, kFrames) << "it had finished before";
  encoder = run.encoder({"--encoder", file});
  ASSERT_TRUE(encoder->says("summer: ready", kLongWait)) << encoder->output();
  const int before = number_before(encoder->output(), " of 640 frames were encoded before"),
            now = number_before(encoder->output(), " of them now");
  EXPECT_EQ(before + now, kFrames) << encoder->output();
  EXPECT_EQ(encoded() - first, kTrial + now) << "the function gets what is not stored";
  EXPECT_GE(before, first - kTrial - 2 * kBatch) << "all is stored but what was on its way";
}

TEST(EncodingInParts, APolicyServiceWaitsForAPythonFunctionThatStartsForLong) {
  ::setenv("CITYLEARN_PYTHON", "/usr/bin/python3", 1);
  Trial run("cyclonedds");
  const std::string file = run.folder() / "encoder.py";
  make_file(file, "import os, time\nwhile not os.path.exists(__file__ + '.go'): time.sleep(0.01)\n" +
                      contents(CITYLEARN_SOURCE_DIR "/tests/support/encoder.py"));
  const auto summer = run.env("summer", kDrawn);
  const auto encoder = run.encoder({"--encoder", file});
  ASSERT_TRUE(encoder->says("starting " + file + " ...", kShortWait)) << encoder->output();
  const auto policy = run.policy({"--wait", "3", "--steps", "512", "--agent", "place_filter"});
  ASSERT_TRUE(policy->says("waiting for features of summer; encoder: starting " + file, kShortWait))
      << policy->output() << "after 5 s, so after those of --wait";
  make_file(file + ".go", "");
  EXPECT_EQ(policy->wait(kLongWait), 0) << policy->output() << encoder->output();
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // which hold memory of their own
TEST(EncodingInParts, TheMemoryOfAPythonFunctionCountsForTheLimit) {
  ::setenv("CITYLEARN_PYTHON", "/usr/bin/python3", 1);
  Trial run("cyclonedds");
  const std::string file = run.folder() / "encoder.py", process = file + ".process";
  make_file(file,
            "import os, numpy\nif not os.path.exists(__file__ + '.process'):\n"
            "    open(__file__ + '.process', 'w').write(str(os.getpid()))\n    held = numpy.ones(60 << 20)\n" +
                contents(CITYLEARN_SOURCE_DIR "/tests/support/encoder.py"));
  const auto summer = run.env("summer", kDrawn);
  const auto encoder = run.encoder({"--encoder", file, "--memory-limit", "400M"});
  ASSERT_TRUE(encoder->says("summer: ready", kLongWait)) << encoder->output();
  EXPECT_TRUE(encoder->says("MB of memory, more than its limit of 400 MB", kShortWait)) << encoder->output();
  EXPECT_NE(::kill(std::stoi(contents(process)), 0), 0) << "the first process is left";
}
#endif

}  // namespace
}  // namespace citylearn::testing
