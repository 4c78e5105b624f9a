// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/onnx/onnx_refusals.h"

#include <gtest/gtest.h>

#include <cmath>
#include <tuple>

#include "tests/support/files.h"
#include "tests/support/networks/onnx_encoder.h"

namespace citylearn::testing {
namespace {

using Sides = std::vector<std::int64_t>;
using Lists = std::vector<std::pair<std::string, Sides>>;

TinyOnnx start(std::int64_t opset = 11) { return TinyOnnx().input({1, 3, 4, 4}).opset(opset); }

/// Returns the network's output, averaged over all places, for the picture's bytes (red, green, blue).
std::vector<float> colours_of(const TinyOnnx& model, const std::string& layer = "", const cv::Mat& picture = kFlat) {
  const Folder folder;
  const auto encoder = make_onnx(network(model.save(folder / "a.onnx"), layer), kBytes);
  const Eigen::VectorXf found = encoder->encode(std::span(&picture, 1)).col(0);
  return {found.begin(), found.end()};
}

/// OpenCV refuses them by name. Other libraries give what ONNX defines, worked out by hand for a picture whose red is
/// 10 y + x + 1, green 20 and blue 10.
TEST(OnnxRefusals, NodesThatOpencvComputesOtherwiseAreNamedOrRight) {
  cv::Mat picture = kFlat.clone();
  for (int i = 0; i < 16; ++i)
    picture.at<cv::Vec3b>(i / 4, i % 4)[2] = static_cast<unsigned char>(i / 4 * 10 + i % 4 + 1);
  const Lists padded = {{"kernel_shape", {3, 3}}, {"pads", {1, 1, 1, 1}}}, open = {{"kernel_shape", {3, 3}}};
  const Lists twos = {{"kernel_shape", {2, 2}}}, halving = {{"kernel_shape", {3, 3}}, {"strides", {2, 2}}};
  const std::vector<float> nine(9, 1), kernel(27, 1), same = {17.5f, 20, 10};
  const auto pooled = [](std::int64_t opset) {
    return start(opset).node("GlobalAveragePool", "pool").node("Flatten", "flat");
  };
  // Each number lies in 2 or 3 of 4 windows a side, so in 100 of 16 * 9 places.
  const std::vector<float> counted = {17.5f * 100 / 144, 20.0f * 100 / 144, 10.0f * 100 / 144};
  const float e10 = std::exp(10.0f), e = std::exp(1.0f);
  const float red = (e + e * e + e * e * e + e * e * e * e) * (1 + e10 + e10 * e10 + e10 * e10 * e10),
              all = red + 16 * (e10 * e10 + e10);
  const std::vector<float> shares = {red / all / 16, e10 * e10 / all, e10 / all};
  const float log16 = std::log(16.0f);
  const std::vector<std::tuple<std::string, TinyOnnx, std::vector<float>>> models = {
      {"AveragePool counts", start().node("AveragePool", "it", {}, padded, {{"count_include_pad", 1}}), counted},
      {"AveragePool of PyTorch", start().producer("pytorch").node("AveragePool", "it", {}, padded), same},
      {"AveragePool same",
       start().node("AveragePool", "it", {}, open, {{"count_include_pad", 1}}, {{"auto_pad", "SAME_UPPER"}}), counted},
      {"AveragePool lower",  // the means of rows and columns 0 and 1, and 1 to 3
       start().node("AveragePool", "it", {}, halving, {}, {{"auto_pad", "SAME_LOWER"}}),
       {14.75f, 20, 10}},
      {"MaxPool lower",  // rows and columns 0, 1, 2, 3
       start().node("MaxPool", "it", {}, twos, {}, {{"auto_pad", "SAME_LOWER"}}), same},
      {"MaxPool dilated",  // rows and columns 2 and 3
       start().node("MaxPool", "it", {}, {{"kernel_shape", {2, 2}}, {"dilations", {2, 2}}}),
       {28.5f, 20, 10}},
      {"Conv lower",  // of 25 numbers in 4 windows
       start().weights("w", {1, 3, 3, 3}, kernel).node("Conv", "it", {"w"}, halving, {}, {{"auto_pad", "SAME_LOWER"}}),
       {(22 + 42 + 123 + 198 + 25 * 31) / 4.0f}},
      {"ConvTranspose",  // each number nine times among 8 x 8
       start()
           .weights("w", {3, 1, 3, 3}, kernel)
           .node("ConvTranspose", "it", {"w"}, {{"kernel_shape", {3, 3}}, {"dilations", {2, 2}}}),
       {9 * 16 * 47.5f / 64}},
      {"Softmax without axis", start().node("Softmax", "it"), shares},
      {"Softmax without axis, 13", start(13).node("Softmax", "it"), {0.25f, 0.25f, 0.25f}},
      {"Softmax of a map", start().node("Softmax", "it", {}, {}, {{"axis", 1}}), shares},
      {"LogSoftmax of a map",
       start().node("LogSoftmax", "it", {}, {}, {{"axis", 2}}),
       {17.5f - std::log(red), -log16, -log16}},
      {"Gemm alpha",
       pooled(11)
           .weights("w", {3, 3}, nine)
           .weights("b", {3}, {1, 2, 3})
           .node("Gemm", "it", {"w", "b"}, {}, {{"transB", 1}}, {}, {{"alpha", 0.5f}}),
       {24.75f, 25.75f, 26.75f}},
      {"Gemm beta",
       pooled(11)
           .weights("w", {3, 3}, nine)
           .weights("b", {3}, {1, 2, 3})
           .node("Gemm", "it", {"w", "b"}, {}, {{"transB", 1}}, {}, {{"beta", 2.0f}}),
       {49.5f, 51.5f, 53.5f}},
      {"Div constant first",
       start().weights("c", {1, 3, 1, 1}, {0, 2, 3}).node("Div", "it", {"c", "@"}),
       {0, 0.1f, 0.3f}},
      {"Less constant first",
       start().weights("c", {1}, {1}).node("Less", "it", {"c", "@"}).node("Cast", "c", {}, {}, {{"to", 1}}),
       {15 / 16.0f, 1, 1}},
      {"Mul by a row", start().weights("c", {4}, {1, 2, 3, 4}).node("Mul", "it", {"c"}), {45, 50, 25}},
      {"Mul by a map",
       start().weights("c", {1, 1, 4, 4}, std::vector<float>(16, 2)).node("Mul", "it", {"c"}),
       {35, 40, 20}},
      {"Add a row",
       start().weights("c", {1, 3, 1, 4}, std::vector<float>(12, 1)).node("Add", "it", {"c"}),
       {18.5f, 21, 11}},
      {"PRelu by a row", start().weights("c", {4}, {1, 2, 3, 4}).node("PRelu", "it", {"c"}), same},
      {"Resize rounding",  // rows and columns 0, 0, 0, 1, 1, 2, 2, 3
       start(13)
           .weights("s", {4}, {1, 1, 2, 2})
           .node("Resize", "it", {"@", "", "s"}, {}, {}, {{"mode", "nearest"}, {"nearest_mode", "floor"}}),
       {11 * 9 / 8.0f + 1, 20, 10}},
      {"Resize scale",  // five places: 0, (1.5, 2.5, 3.5, 4.5) / 1.3 - 0.5
       start(13)
           .weights("s", {4}, {1, 1, 1.3f, 1.3f})
           .node("Resize", "it", {"@", "", "s"}, {}, {},
                 {{"mode", "linear"}, {"coordinate_transformation_mode", "half_pixel"}}),
       {11 * (12 / 1.3f - 2) / 5 + 1, 20, 10}},
      {"Cast to integer",  // a tenth without its fraction
       start()
           .weights("tenth", {1}, {0.1f})
           .node("Mul", "less", {"tenth"})
           .node("Cast", "it", {}, {}, {{"to", 6}})
           .node("Cast", "back", {}, {}, {{"to", 1}}),
       {1.5f, 2, 1}},
      {"Concat",
       start().weights("c", {1, 1, 4, 4}, std::vector<float>(16, 1)).node("Concat", "it", {"c"}, {}, {{"axis", 1}}),
       {17.5f, 20, 10, 1}},
      {"CumSum", start().integers("i", {2}).node("CumSum", "it", {"i"}), {31.25f, 50, 25}},
      {"lengths over a row",
       start().node("Relu", "x").node("ReduceL2", "n", {}, {{"axes", {2}}}).node("Div", "it", {"x_out", "@"}),
       {(64 / std::sqrt(1524.0f) + 68 / std::sqrt(1656.0f) + 72 / std::sqrt(1796.0f) + 76 / std::sqrt(1944.0f)) / 16,
        0.5f, 0.5f}},
  };
  for (const auto& [what, model, wanted] : models) {
    std::vector<float> found;
    const std::string error = error_of([&, &planted = model] { found = colours_of(planted, "", picture); });
    if (!by_opencv()) {
      ASSERT_EQ(error, "") << what;
      ASSERT_EQ(found.size(), wanted.size()) << what;
      for (std::size_t i = 0; i < found.size(); ++i)
        EXPECT_NEAR(found[i], wanted[i], 1e-5f * (1 + std::abs(wanted[i]))) << what;
      continue;
    }
    for (const char* part : {"a.onnx: ", "OpenCV ", ", node 'it'", " ("})
      EXPECT_TRUE(holds(error, part)) << what << ": " << error;
    EXPECT_TRUE(contains(error, what.starts_with("lengths") ? "Div" : "operator " + what.substr(0, what.find(' '))));
  }
}

TEST(OnnxRefusals, PaddingOfDilatedConvolutionsIsNotComputed) {
  const std::string error = error_of([] {
    colours_of(start()
                   .weights("w", {1, 3, 3, 3}, std::vector<float>(27, 1))
                   .node("Conv", "it", {"w"}, {{"kernel_shape", {3, 3}}, {"dilations", {2, 2}}}, {},
                         {{"auto_pad", "SAME_UPPER"}}));
  });
  EXPECT_TRUE(holds(error, "a.onnx: "));
  EXPECT_TRUE(contains(error, by_opencv() ? ", node 'it'" : "Dilation not supported")) << error;
}

TEST(OnnxRefusals, TheirRightTwinsGiveTheRightNumbers) {
  const Lists padded = {{"kernel_shape", {3, 3}}, {"pads", {1, 1, 1, 1}}};
  // Of 4 x 4 places four have 4 of 9 numbers within the picture, eight 6 and four all.
  const float inside = (4 * 4 + 8 * 6 + 4 * 9) / 9.0f / 16;
  const auto scales = [](float factor) { return start(13).weights("s", {4}, {1, 1, factor, factor}); };
  const std::vector<std::tuple<std::string, TinyOnnx, std::vector<float>>> models = {
      {"AveragePool", start().node("AveragePool", "it", {}, padded), {30, 20, 10}},
      {"AveragePool of PyTorch",
       start().producer("pytorch").node("AveragePool", "it", {}, padded, {{"count_include_pad", 1}}),
       {30 * inside, 20 * inside, 10 * inside}},
      {"AveragePool without padding",
       start().producer("pytorch").node("AveragePool", "it", {}, {{"kernel_shape", {2, 2}}}),
       {30, 20, 10}},
      {"MaxPool lower",
       start().node("MaxPool", "it", {}, {{"kernel_shape", {3, 3}}}, {}, {{"auto_pad", "SAME_LOWER"}}),
       {30, 20, 10}},
      {"Softmax of a row",
       start().node("GlobalAveragePool", "p").node("Flatten", "f").node("Softmax", "it"),
       {1 / (1 + std::exp(-10.0f) + std::exp(-20.0f)), std::exp(-10.0f), std::exp(-20.0f)}},
      {"Softmax of the last side", start().node("Softmax", "it", {}, {}, {{"axis", 3}}), {0.25f, 0.25f, 0.25f}},
      {"Softmax over channels",
       start(13).node("Softmax", "it", {}, {}, {{"axis", 1}}),
       {1 / (1 + std::exp(-10.0f) + std::exp(-20.0f)), std::exp(-10.0f), std::exp(-20.0f)}},
      {"Div by channel", start().weights("c", {1, 3, 1, 1}, {3, 4, 5}).node("Div", "it", {"c"}), {10, 5, 2}},
      {"one number first", start().weights("c", {1}, {60}).node("Div", "it", {"c", "@"}), {2, 3, 6}},
      {"Mul by channel", start().weights("c", {3, 1, 1}, {1, 2, 3}).node("Mul", "it", {"c"}), {30, 40, 30}},
      {"Mul by its own mean",
       start().node("Relu", "x").node("GlobalAveragePool", "m").node("Mul", "it", {"x_out", "@"}),
       {900, 400, 100}},
      {"Add a row", start().weights("c", {4}, {1, 2, 3, 6}).node("Add", "it", {"c"}), {33, 23, 13}},
      {"Resize", scales(2).node("Resize", "it", {"@", "", "s"}, {}, {}, {{"mode", "nearest"}}), {30, 20, 10}},
      {"Cast", start().node("Cast", "it", {}, {}, {{"to", 1}}), {30, 20, 10}},
      {"lengths over channels",
       start().node("Relu", "x").node("ReduceL2", "n", {}, {{"axes", {1}}}).node("Div", "it", {"x_out", "@"}),
       {30 / std::sqrt(1400.0f), 20 / std::sqrt(1400.0f), 10 / std::sqrt(1400.0f)}},
  };
  for (const auto& [what, model, expected] : models) {
    std::vector<float> found;
    ASSERT_EQ(error_of([&, &same = model] { found = colours_of(same); }), "") << what;
    ASSERT_EQ(found.size(), expected.size()) << what;
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 1e-4f * expected[0]) << what << i;
  }
}

TEST(OnnxRefusals, NodesBehindTheLayerDoNotCount) {
  const TinyOnnx model = start().node("Relu", "early").node("Softmax", "late");
  EXPECT_EQ(colours_of(model, "early"), (std::vector<float>{30, 20, 10}));
  const std::string error = error_of([&] { colours_of(model, "late"); });
  EXPECT_TRUE(by_opencv() ? contains(error, "node 'late'") : ::testing::AssertionResult(error.empty())) << error;

  // OpenCV imports the whole file.
  const TinyOnnx strange = start().node("Relu", "early").node("Frobnicate", "late");
  std::vector<float> found;
  const std::string unknown = error_of([&] { found = colours_of(strange, "early"); });
  EXPECT_TRUE(by_opencv() ? contains(unknown, "Frobnicate") : ::testing::AssertionResult(found.size() == 3)) << unknown;
}

}  // namespace
}  // namespace citylearn::testing
