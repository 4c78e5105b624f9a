// SPDX-License-Identifier: Apache-2.0
// The pictures of dataset synthetic: lazily drawn, the same when asked again, smooth along the route, and about as hard
// to recognise under another condition as real ones.
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "tests/support/env/env.h"

namespace citylearn::testing {
namespace {

using Numbers = std::map<std::string, double>;

constexpr int kFrames = 96;

std::unique_ptr<Dataset> city(const Numbers& parameters = {}) { return make_dataset("synthetic", "", parameters); }

Bytes file(const Traversal& traversal, int frame) {
  Bytes bytes;
  traversal.images->read(frame, bytes);
  return bytes;
}

cv::Mat picture(const Traversal& traversal, int frame) {
  Bytes bytes = file(traversal, frame);
  return cv::imdecode(cv::Mat(1, static_cast<int>(bytes.size()), CV_8U, bytes.data()), cv::IMREAD_COLOR);
}

double difference(const cv::Mat& a, const cv::Mat& b) {
  return cv::norm(a, b, cv::NORM_L1) / static_cast<double>(a.total() * 3);
}

/// Gradients by direction in cells of 8 x 8 pixels, 2 x 2 of them scaled to length 1 (Dalal & Triggs, CVPR 2005).
cv::Mat gradients(const cv::Mat& colour) {
  cv::Mat grey, across, down;
  cv::cvtColor(colour, grey, cv::COLOR_BGR2GRAY);
  cv::resize(grey, grey, {128, 64});
  cv::Sobel(grey, across, CV_32F, 1, 0, 1);
  cv::Sobel(grey, down, CV_32F, 0, 1, 1);
  cv::Mat cells = cv::Mat::zeros(8, 16, CV_32FC(9)), blocks;
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 128; ++x) {
      const float dx = across.at<float>(y, x), dy = down.at<float>(y, x);
      const double turn = std::fmod(std::atan2(dy, dx) + 2 * CV_PI, CV_PI) / CV_PI * 9;
      cells.ptr<float>(y / 8, x / 8)[static_cast<int>(turn) % 9] += std::hypot(dx, dy);
    }
  for (int y = 0; y < 7; ++y)
    for (int x = 0; x < 15; ++x) {
      const cv::Mat block = cells(cv::Rect(x, y, 2, 2)).clone().reshape(1, 1);
      blocks.push_back(cv::Mat(block / (cv::norm(block) + 1e-3)));
    }
  return blocks.reshape(1, 1);
}

using Pictures = std::vector<cv::Mat>;

/// The first frames of each drive, drawn once for all tests.
const std::map<std::string, Pictures>& drives() {
  static const std::map<std::string, Pictures> all = [] {
    std::map<std::string, Pictures> drawn;
    const auto dataset = city({{"frames", kFrames}});
    for (const std::string& name : dataset->names()) {
      const Traversal traversal = dataset->load(name);
      for (int frame = 0; frame < kFrames; ++frame) drawn[name].push_back(picture(traversal, frame));
    }
    return drawn;
  }();
  return all;
}

/// A descriptor a row, without the mean of all and of length 1.
cv::Mat descriptors(const Pictures& pictures) {
  cv::Mat rows, mean;
  for (const cv::Mat& one : pictures) rows.push_back(gradients(one));
  cv::reduce(rows, mean, 0, cv::REDUCE_AVG);
  for (int frame = 0; frame < rows.rows; ++frame) {
    rows.row(frame) -= mean;
    rows.row(frame) /= cv::norm(rows.row(frame));
  }
  return rows;
}

/// Share of frames whose most similar one (the largest number of its row) is at most two frames off.
double recognised(const cv::Mat& similarity) {
  int right = 0;
  for (int frame = 0; frame < similarity.rows; ++frame) {
    cv::Point best;
    cv::minMaxLoc(similarity.row(frame), nullptr, nullptr, nullptr, &best);
    right += std::abs(best.x - frame) <= 2;
  }
  return static_cast<double>(right) / similarity.rows;
}

TEST(Drawn, ShowsSevenDrivesOfTheSameRoute) {
  const auto dataset = city({{"frames", 40}});
  EXPECT_EQ(dataset->names(),
            (std::vector<std::string>{"summer", "fall", "winter", "night", "overcast", "rain", "shifted"}));
  const Traversal summer = dataset->load("summer");
  std::set<std::uint64_t> hashes;
  for (const std::string& name : dataset->names()) {
    const Traversal traversal = dataset->load(name);
    EXPECT_EQ(traversal.condition, name);
    EXPECT_EQ(traversal.frames, 40);
    EXPECT_EQ(traversal.dimension, 0);
    ASSERT_TRUE(traversal.images);
    EXPECT_EQ(traversal.images->frames(), 40);
    EXPECT_EQ(traversal.images->fault(3), "");
    EXPECT_EQ(traversal.images->name(3), name + ", frame 3");
    EXPECT_EQ(traversal.positions, summer.positions);
    EXPECT_EQ(picture(traversal, 20).size(), cv::Size(160, 96));
    hashes.insert(traversal.hash());
  }
  EXPECT_EQ(hashes.size(), 7u);
  EXPECT_THROW(dataset->load("spring"), Error);
}

TEST(Drawn, AFrameIsTheSameInWhateverOrderItIsRead) {
  const Traversal once = city({{"frames", 600}})->load("rain"), again = city({{"frames", 600}})->load("rain");
  const Bytes first = file(once, 5);
  // Far enough apart for the places to be forgotten and made anew.
  for (int frame = 0; frame < 600; frame += 12) file(once, frame);
  EXPECT_EQ(file(once, 5), first);
  EXPECT_EQ(file(again, 5), first);
  EXPECT_NE(file(once, 6), first);
}

TEST(Drawn, FingerprintsFollowEveryParameterThatChangesPictures) {
  std::set<std::uint64_t> prints{city()->load("shifted").images->fingerprint(7)};
  const std::vector<Numbers> others{{{"seed", 2}},    {{"width", 128}},       {{"height", 80}},
                                    {{"spacing", 5}}, {{"countryside", 0.5}}, {{"viewpoint", 1}}};
  for (const Numbers& other : others) prints.insert(city(other)->load("shifted").images->fingerprint(7));
  EXPECT_EQ(prints.size(), 7u);
  EXPECT_EQ(city()->load("shifted").images->fingerprint(7),
            city({{"frames", 50}})->load("shifted").images->fingerprint(7));
}

TEST(Drawn, SizesStretchesAndSpacingsAreAsAskedFor) {
  const Numbers tiny{{"frames", 4}, {"width", 33}, {"height", 47}, {"spacing", 0.05}, {"countryside", 1}};
  for (const std::string& name : city()->names()) {
    const Traversal traversal = city(tiny)->load(name);
    EXPECT_EQ(picture(traversal, 3).size(), cv::Size(33, 47));
  }
  EXPECT_NEAR(city(tiny)->load("fall").positions[3], 0.15, 0.05);
  const Traversal street = city({{"frames", 2}, {"countryside", 0}})->load("summer");
  const Traversal fields = city({{"frames", 2}, {"countryside", 1}})->load("summer");
  EXPECT_GT(difference(picture(street, 0), picture(fields, 0)), 10);
  EXPECT_THROW(city({{"spacing", 0.01}}), Error);
  EXPECT_THROW(city({{"countryside", 1.5}}), Error);
  EXPECT_THROW(city({{"width", 2000}}), Error);
}

TEST(Drawn, NeighboursLookAlike) {
  const Pictures& summer = drives().at("summer");
  double next = 0, distant = 0;
  for (std::size_t frame = 0; frame + 30 < kFrames; ++frame) {
    next += difference(summer[frame], summer[frame + 1]);
    distant += difference(summer[frame], summer[frame + 30]);
  }
  EXPECT_LT(next, 0.7 * distant);
}

TEST(Drawn, ConditionsAreHarderOrEasierToRecognise) {
  const cv::Mat summer = descriptors(drives().at("summer"));
  std::map<std::string, double> share;
  for (const auto& [name, pictures] : drives()) share[name] = recognised(descriptors(pictures) * summer.t());
  EXPECT_EQ(share["summer"], 1);
  EXPECT_GT(share["fall"], 0.7);
  EXPECT_GT(share["overcast"], 0.7);
  for (const char* name : {"winter", "rain", "shifted"}) EXPECT_GT(share[name], 0.4) << name;
  EXPECT_GT(share["night"], 0.25);
  EXPECT_LT(share["night"], 0.95);
  EXPECT_LT(share["shifted"], 0.95);
}

TEST(Drawn, PixelsAloneDoNotTellPlacesUnderAnotherCondition) {
  const auto halved = [](const Pictures& pictures) {
    Pictures small(pictures.size());
    for (std::size_t i = 0; i < small.size(); ++i) cv::resize(pictures[i], small[i], {}, 0.5, 0.5, cv::INTER_AREA);
    return small;
  };
  const Pictures summer = halved(drives().at("summer"));
  for (const auto& [name, drive] : drives()) {
    const Pictures pictures = halved(drive);
    cv::Mat similarity(kFrames, kFrames, CV_64F);
    for (int i = 0; i < kFrames; ++i)
      for (int j = 0; j < kFrames; ++j)
        similarity.at<double>(i, j) =
            -difference(pictures[static_cast<std::size_t>(i)], summer[static_cast<std::size_t>(j)]);
    if (name == "summer")
      EXPECT_EQ(recognised(similarity), 1);
    else
      EXPECT_LT(recognised(similarity), 1) << name;
  }
}

}  // namespace
}  // namespace citylearn::testing
