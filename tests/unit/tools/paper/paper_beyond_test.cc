// SPDX-License-Identifier: Apache-2.0
// What ./run paper's sections beyond the paper stand on: trials over seeds, shifted cameras, agents carried elsewhere.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "core/util/error.h"
#include "encoder_service/encoding/encoder.h"
#include "tests/support/service.h"
#include "tools/paper/cropped.h"
#include "tools/paper/study.h"
#include "tools/paper/trials.h"

namespace citylearn::paper {
namespace {

using citylearn::testing::Folder;

Json row(const std::string& traversal, double completed, double spl) {
  return {{"traversal", traversal}, {"tasks", 100}, {"completed", completed}, {"spl", spl},
          {"excess", nullptr},      {"steps", 5},   {"reward", 0.5}};
}

TEST(Trials, AreMeansOverSeedsOrOfOneSeedAShare) {
  Json shuffled = row("fall", 0.1, 0.1);
  shuffled["shuffled"] = true;
  const std::vector<Json> two = {{row("summer", 1, 0.9), row("fall", 0.5, 0.4), shuffled}, {row("fall", 0.7, 0.6)}};
  const Trials trials = trials_on(two, "fall");
  EXPECT_EQ(trials.seeds, 2);
  EXPECT_EQ(seeds_by_tasks(trials), "2 x 100");
  EXPECT_DOUBLE_EQ(trials.completed.mean, 0.6);
  EXPECT_DOUBLE_EQ(trials.spl.mean, 0.5);
  EXPECT_TRUE(std::isnan(trials.excess.mean)) << "nobody completed a task";
  EXPECT_DOUBLE_EQ(trials_on(two, "fall", /*shuffled=*/true).completed.mean, 0.1);
  const Trials one = trials_on(two, "summer");
  EXPECT_EQ(one.completed.n, 100);
  EXPECT_NEAR(one.completed.low, 0.963, 0.001);
  EXPECT_EQ(trials_on({nullptr}, "summer").seeds, 0);
  EXPECT_EQ(seeds_by_tasks(trials_on({nullptr}, "summer")), "-");
}

TEST(Trials, AreWorseBeyondTheMarginAndByMoreThanChance) {
  const Estimate yardstick{0.9, NAN, NAN, 1};
  EXPECT_TRUE(worse({0.8, 0.75, 0.85, 5}, yardstick, 0.01));
  EXPECT_FALSE(worse({0.8, 0.65, 0.95, 5}, yardstick, 0.01));
  EXPECT_TRUE(worse({0.8, NAN, NAN, 1}, yardstick, 0.01));
  EXPECT_FALSE(worse({0.895, NAN, NAN, 1}, yardstick, 0.01));
  EXPECT_FALSE(worse({NAN, NAN, NAN, 0}, yardstick, 0.01));
}

/// Pictures of 20 x 2 whose columns are numbered.
class Numbered : public Images {
 public:
  int frames() const override { return 3; }
  void read(int frame, Bytes& bytes) override {
    cv::Mat picture(2, 20, CV_8UC3);
    for (int x = 0; x < picture.cols; ++x) picture.col(x).setTo(cv::Scalar(x, frame, 7));
    std::vector<unsigned char> file;
    cv::imencode(".png", picture, file);
    bytes.resize(file.size());
    std::memcpy(bytes.data(), file.data(), file.size());
  }
  std::string name(int frame) const override { return "number " + std::to_string(frame); }
  std::uint64_t fingerprint(int frame) const override { return static_cast<std::uint64_t>(frame); }
  std::string fault(int) const override { return {}; }
};

TEST(Cropped, ShowsThePartAskedFor) {
  const auto pictures = std::make_shared<Numbered>();
  const auto part = cropped(pictures, 0.1, 0.8);
  Bytes bytes;
  part->read(2, bytes);
  const cv::Mat picture = decode_picture(bytes, "a part");
  ASSERT_EQ(picture.cols, 16);
  ASSERT_EQ(picture.rows, 2);
  EXPECT_EQ(picture.at<cv::Vec3b>(1, 0), cv::Vec3b(2, 2, 7));
  EXPECT_EQ(picture.at<cv::Vec3b>(0, 15), cv::Vec3b(17, 2, 7));
  EXPECT_NE(part->fingerprint(2), pictures->fingerprint(2));
  EXPECT_NE(part->fingerprint(2), cropped(pictures, 0.2, 0.8)->fingerprint(2));
  EXPECT_THROW(cropped(pictures, 0.3, 0.8), Error);
}

Source drawn(int frames, bool pictures) {
  Source source;
  source.parameters["synthetic"] = {
      {"frames", static_cast<double>(frames)}, {"images", pictures ? 1.0 : 0.0}, {"width", 64}, {"height", 48}};
  return source;
}

TEST(Aside, IsTheSameRouteFromTheSide) {
  WorldOptions options;
  options.source = drawn(5, true);
  options.most_frames = 4;
  World world(options);
  World& aside = world.aside();
  EXPECT_EQ(&aside, &world.aside());
  ASSERT_EQ(aside.names(), (std::vector<std::string>{"summer", "0 m", "0.5 m", "1 m", "2 m", "3 m"}));
  EXPECT_EQ(aside.frames(), 4);
  EXPECT_EQ(aside.hash("summer"), world.hash("summer")) << "what is learned from is as it was";
  Bytes near, far;
  aside.recording("0.5 m").images->read(0, near);
  aside.recording("3 m").images->read(0, far);
  EXPECT_NE(near, far);
  EXPECT_NE(aside.hash("0.5 m"), aside.hash("3 m"));
}

TEST(Aside, OfRealPicturesIsAWindowThatMoves) {
  const Folder folder;
  std::filesystem::create_directories(folder / "summer");
  Numbered pictures;
  Bytes bytes;
  for (int frame = 0; frame < 3; ++frame) {
    pictures.read(frame, bytes);
    cv::imwrite(folder / ("summer/" + std::to_string(frame) + ".png"), decode_picture(bytes, "a picture"));
  }
  WorldOptions options;
  options.source.dataset = "plain";
  options.source.folder = folder / "";
  World world(options);
  World& aside = world.aside();
  ASSERT_EQ(aside.names(), (std::vector<std::string>{"summer", "0 %", "5 %", "10 %", "20 %"}));
  Bytes reference, same, moved;
  aside.recording("summer").images->read(1, reference);
  aside.recording("0 %").images->read(1, same);
  aside.recording("20 %").images->read(1, moved);
  EXPECT_EQ(reference, same);
  const cv::Mat first = decode_picture(reference, "reference"), last = decode_picture(moved, "moved");
  ASSERT_EQ(first.cols, 16);
  ASSERT_EQ(last.cols, 16);
  EXPECT_EQ(first.at<cv::Vec3b>(0, 0), cv::Vec3b(0, 1, 7));
  EXPECT_EQ(last.at<cv::Vec3b>(0, 0), cv::Vec3b(4, 1, 7));
}

TEST(Aside, NeedsPictures) {
  WorldOptions options;
  options.source = drawn(5, false);
  World world(options);
  EXPECT_THROW(world.aside(), Error);
}

Study short_study() {
  Study study;
  study.agent = "place_filter";
  study.learner = "relabel";
  study.representation = "features";
  study.frames = 12;
  study.steps = 1024;
  study.tasks = 20;
  study.traversals = {"summer"};
  study.keep = true;
  return study;
}

TEST(Carried, IsTheAgentThatWasKeptBitForBit) {
  WorldOptions options;
  options.source = drawn(24, false);
  World world(options);
  const Folder folder;
  const Study source = short_study();
  const auto carried_to = [&](int first, const Work& work) {
    return unit_of(Carried{kept(source, world, work), "features", first, 12, 20, {"summer", "fall"}}, world);
  };
  Study further = source;
  further.keep = false;
  further.first = 12;
  further.frozen = {"filter"};

  Json here;
  for (const std::string run : {"one", "two"}) {
    Work work(folder / run);
    work.add(unit_of(source, world));
    work.add(carried_to(0, work));
    work.add(carried_to(12, work));
    further.initial = kept(source, world, work);
    work.add(unit_of(further, world));
    ASSERT_TRUE(work.run());
    const Json& trained = work.outcome(unit_of(source, world).spec);
    Json again = work.outcome(carried_to(0, work).spec)[0];
    again["shuffled"] = false;
    Json before = trained["trials"][0];
    before.erase("walk");  // shown of trainings alone
    EXPECT_EQ(again, before) << "on its own route it does what it did";
    EXPECT_NE(work.outcome(carried_to(12, work).spec)[0], again);
    Json outcome = work.outcome(unit_of(further, world).spec);
    EXPECT_FALSE(outcome.contains("parameters"));
    EXPECT_GE(outcome["steps"], 1024);
    if (run == "one")
      here = outcome["trials"];
    else
      EXPECT_EQ(here, outcome["trials"]);
  }
}

TEST(Carried, FailsWithTheTrainingItNeeds) {
  WorldOptions options;
  options.source = drawn(24, false);
  World world(options);
  const Folder folder;
  Work work(folder / "work");
  Study impossible = short_study();
  impossible.frozen = {"nothing of that name"};
  work.add(unit_of(impossible, world));
  const Unit carried = unit_of(Carried{kept(impossible, world, work), "features", 12, 12, 20, {"summer"}}, world);
  work.add(carried);
  EXPECT_FALSE(work.run());
  EXPECT_TRUE(work.outcome(carried.spec).is_null());
}

}  // namespace
}  // namespace citylearn::paper
