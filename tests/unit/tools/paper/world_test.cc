// SPDX-License-Identifier: Apache-2.0
// The recordings of a study.
#include "tools/paper/world.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "core/util/error.h"
#include "encoder_service/encoding/encoder.h"
#include "tests/support/processes/service.h"
#include "tests/unit/tools/paper/numbered_pictures.h"

namespace citylearn::paper {
namespace {

using citylearn::testing::Folder;

Source drawn(int frames, bool pictures) {
  Source source;
  source.parameters["synthetic"] = {
      {"frames", static_cast<double>(frames)}, {"images", pictures ? 1.0 : 0.0}, {"width", 64}, {"height", 48}};
  return source;
}

TEST(LaterallyShifted, IsTheSameRouteFromTheSide) {
  WorldOptions options;
  options.source = drawn(5, true);
  options.most_frames = 4;
  World world(options);
  World& shifted = world.laterally_shifted();
  EXPECT_EQ(&shifted, &world.laterally_shifted());
  ASSERT_EQ(shifted.names(), (std::vector<std::string>{"summer", "0 m", "0.5 m", "1 m", "2 m", "3 m"}));
  EXPECT_EQ(shifted.frames(), 4);
  EXPECT_EQ(shifted.hash("summer"), world.hash("summer")) << "what is learned from is as it was";
  Bytes near, far;
  shifted.recording("0.5 m").images->read(0, near);
  shifted.recording("3 m").images->read(0, far);
  EXPECT_NE(near, far);
  EXPECT_NE(shifted.hash("0.5 m"), shifted.hash("3 m"));
}

TEST(LaterallyShifted, OfRealPicturesIsAWindowThatMoves) {
  const Folder folder;
  std::filesystem::create_directories(folder / "summer");
  NumberedPictures pictures;
  Bytes bytes;
  for (int frame = 0; frame < 3; ++frame) {
    pictures.read(frame, bytes);
    cv::imwrite(folder / ("summer/" + std::to_string(frame) + ".png"), decode_picture(bytes, "a picture"));
  }
  WorldOptions options;
  options.source.dataset = "plain";
  options.source.folder = folder / "";
  World world(options);
  World& shifted = world.laterally_shifted();
  ASSERT_EQ(shifted.names(), (std::vector<std::string>{"summer", "0 %", "5 %", "10 %", "20 %"}));
  Bytes reference, same, moved;
  shifted.recording("summer").images->read(1, reference);
  shifted.recording("0 %").images->read(1, same);
  shifted.recording("20 %").images->read(1, moved);
  EXPECT_EQ(reference, same);
  const cv::Mat first = decode_picture(reference, "reference"), last = decode_picture(moved, "moved");
  ASSERT_EQ(first.cols, 16);
  ASSERT_EQ(last.cols, 16);
  EXPECT_EQ(first.at<cv::Vec3b>(0, 0), cv::Vec3b(0, 1, 7));
  EXPECT_EQ(last.at<cv::Vec3b>(0, 0), cv::Vec3b(4, 1, 7));
}

TEST(LaterallyShifted, NeedsPictures) {
  WorldOptions options;
  options.source = drawn(5, false);
  World world(options);
  EXPECT_THROW(world.laterally_shifted(), Error);
}

}  // namespace
}  // namespace citylearn::paper
