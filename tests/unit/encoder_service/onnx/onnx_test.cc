// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>

#include "encoder_service/onnx/onnx_network.h"
#include "encoder_service/onnx/onnx_refusals.h"
#include "tests/paths.h"
#include "tests/support/data/real_data.h"
#include "tests/support/files.h"
#include "tests/support/networks/onnx_encoder.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

cv::Mat noise(int width, int height, int seed) {
  cv::Mat picture(height, width, CV_8UC3);
  cv::RNG(static_cast<std::uint64_t>(seed)).fill(picture, cv::RNG::UNIFORM, 0, 256);
  return picture;
}

/// A real network among the shared data; empty when there is none.
std::string net(const std::string& name) { return testing::real_data(CITYLEARN_SOURCE_DIR, "nets/" + name); }

/// One picture through OpenCV alone: its own preprocessing (ImageNet), its own network.
Eigen::VectorXf bare(const std::string& path, const std::string& layer, const cv::Mat& picture) {
  cv::dnn::Net net_of_path = cv::dnn::readNetFromONNX(path);
  cv::Mat blob = cv::dnn::blobFromImage(picture, 1 / 255.0, cv::Size(), cv::Scalar(), true);
  const float mean[] = {0.485f, 0.456f, 0.406f}, deviation[] = {0.229f, 0.224f, 0.225f};
  for (int c = 0; c < 3; ++c) {
    cv::Mat plane(picture.rows, picture.cols, CV_32F, blob.ptr<float>(0, c));
    plane = (plane - mean[c]) / deviation[c];
  }
  net_of_path.setInput(blob);
  const cv::Mat output = net_of_path.forward(layer);
  return Eigen::Map<const Eigen::VectorXf>(output.ptr<float>(), static_cast<Eigen::Index>(output.total()));
}

struct Onnx : ::testing::Test {
  const Folder folder;
};

TEST_F(Onnx, ComputesWhatTheModelSays) {
  constexpr int kMaps = 4, kWidth = 9, kHeight = 7;
  std::vector<float> kernel;
  const std::string path = tiny_convolution({1, 3, kHeight, kWidth}, kMaps, &kernel).save(folder / "a.onnx");
  const auto encoder = make_onnx(network(path, "", "netvlad-vgg"));
  const cv::Mat picture = noise(kWidth, kHeight, 1);
  ASSERT_EQ(encoder->spec().dimension, kMaps);
  const Eigen::MatrixXf got = encoder->encode(std::span(&picture, 1));
  const double mean[] = {123.68, 116.779, 103.939};
  for (int m = 0; m < kMaps; ++m) {
    double sum = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        double here = 0;
        for (int c = 0; c < 3; ++c)
          for (int i = 0; i < 9; ++i) {
            const int v = y + i / 3 - 1, u = x + i % 3 - 1;
            if (v < 0 || v >= kHeight || u < 0 || u >= kWidth) continue;
            const double pixel = picture.at<cv::Vec3b>(v, u)[2 - c] - mean[c];
            here += pixel * static_cast<double>(kernel[static_cast<std::size_t>((m * 3 + c) * 9 + i)]);
          }
        sum += std::max(here, 0.0);
      }
    EXPECT_NEAR(got(m, 0), sum / (kWidth * kHeight), 1e-3) << m;
  }
}

TEST_F(Onnx, GemmKeepsTheOrderOfItsOutput) {
  // Three rows that each pick one channel of the pooled picture.
  const std::string path = TinyOnnx()
                               .input({-1, 3, 4, 4})
                               .weights("w", {3, 3}, {0, 0, 2, 0, 2, 0, 2, 0, 0})
                               .weights("b", {3}, {1, 10, 100})
                               .node("GlobalAveragePool", "pool")
                               .node("Flatten", "flat", {}, {}, {{"axis", 1}})
                               .node("Gemm", "gemm", {"w", "b"}, {}, {{"transB", 1}})
                               .save(folder / "a.onnx");
  const auto encoder = make_onnx(network(path), kBytes);
  const cv::Mat picture(4, 4, CV_8UC3, cv::Scalar(10, 20, 30));
  const Eigen::MatrixXf got = encoder->encode(std::span(&picture, 1));
  EXPECT_TRUE(got.isApprox(Eigen::Vector3f(21, 50, 160))) << got;
}

TEST_F(Onnx, PreprocessingIsPerChannel) {
  const std::string path = TinyOnnx().input({1, 3, -1, -1}).node("GlobalAveragePool", "pool").save(folder / "a.onnx");
  const Values size = {{"width", 8}, {"height", 6}};
  const cv::Mat picture(50, 70, CV_8UC3, cv::Scalar(51, 102, 204));  // any size; 0.2, 0.4, 0.8
  const auto encode = [&](Values values, const std::string& preset = "") {
    values.insert(size.begin(), size.end());
    return Eigen::VectorXf(make_onnx(network(path, "", preset), values)->encode(std::span(&picture, 1)));
  };
  const Eigen::Vector3f rgb((0.8f - 0.485f) / 0.229f, (0.4f - 0.456f) / 0.224f, (0.2f - 0.406f) / 0.225f);
  EXPECT_TRUE(encode({}).isApprox(rgb, 1e-5f));
  EXPECT_TRUE(encode({{"rgb", 0}}).isApprox(rgb.reverse(), 1e-5f));
  EXPECT_TRUE(encode({}, "netvlad").isApprox(rgb, 1e-5f));
  EXPECT_TRUE(encode({}, "netvlad-vgg").isApprox(Eigen::Vector3f(204 - 123.68f, 102 - 116.779f, 51 - 103.939f), 1e-5f));
  EXPECT_TRUE(encode({}, "mobilenet").isApprox(Eigen::Vector3f(0.6f, -0.2f, -0.6f), 1e-5f));
  EXPECT_NEAR(encode({{"mean-green", 0.1}, {"deviation-green", 2}, {"scale", 10}})[1], (4 - 0.1) / 2, 1e-5);
}

TEST_F(Onnx, EachPictureAloneOrWithOthersIsTheSame) {
  const std::string path = tiny_convolution({-1, 3, 12, 16}, 8).save(folder / "a.onnx");
  std::vector<cv::Mat> pictures;
  for (int i = 0; i < 5; ++i) pictures.push_back(noise(16 + 7 * i, 12 + 5 * i, i));
  const auto encoder = make_onnx(network(path));
  const Eigen::MatrixXf together = encoder->encode(pictures);
  ASSERT_EQ(together.cols(), 5);
  for (int i = 4; i >= 0; --i) {
    const Eigen::MatrixXf alone = make_onnx(network(path))->encode(std::span(&pictures[i], 1));
    // ONNX Runtime: up to the rounding of a batched product.
    EXPECT_TRUE(alone.isApprox(together.col(i), by_opencv() ? 0 : 1e-5f)) << i;
  }
  EXPECT_EQ(encoder->encode(pictures), together);
  EXPECT_EQ(encoder->encode({}).cols(), 0);
}

TEST_F(Onnx, FeatureMapsAreAveragedUnlessAskedOtherwise) {
  const std::string path = tiny_convolution({1, 3, 6, 8}, 5).save(folder / "a.onnx");
  const cv::Mat picture = noise(8, 6, 3);
  const auto encode = [&](const EncoderFiles& files, const Values& values) {
    return make_onnx(files, values)->encode(std::span(&picture, 1));
  };
  const Eigen::MatrixXf pooled = encode(network(path), {});
  EXPECT_TRUE(encode(network(path, "relu"), {}).isApprox(pooled, 1e-5f));
  const Eigen::MatrixXf whole = encode(network(path, "onnx_node!relu"), {{"pool", 0}});
  ASSERT_EQ(whole.rows(), 5 * 6 * 8);
  EXPECT_TRUE(whole.reshaped(48, 5).colwise().mean().transpose().isApprox(pooled, 1e-5f));
}

TEST_F(Onnx, AGridOfMeansOpensALargeMap) {
  cv::Mat picture(3, 5, CV_8UC3, cv::Scalar(0, 100, 200));
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 5; ++x) picture.at<cv::Vec3b>(y, x)[2] = static_cast<unsigned char>(10 * y + x);
  Values values = kBytes;
  values["pool"] = 2;
  const std::string small = TinyOnnx().input({1, 3, 3, 5}).node("Relu", "relu").save(folder / "small.onnx");
  const auto encoder = make_onnx(network(small), values);
  EXPECT_TRUE(encoder->spec().name.ends_with(" pool=2"));
  // Rows 0 and 1, 1 and 2; columns 0 to 2, 2 to 4.
  const Eigen::VectorXf wanted{{6, 8, 16, 18, 100, 100, 100, 100, 0, 0, 0, 0}};
  const Eigen::MatrixXf found = encoder->encode(std::span(&picture, 1));
  EXPECT_TRUE(found.isApprox(wanted, 1e-6f)) << found;

  const std::string large = TinyOnnx().input({1, 3, 200, 200}).node("Relu", "relu").save(folder / "large.onnx");
  EXPECT_TRUE(holds(refusal(network(large), {{"pool", 0}}), "gives 120000 numbers"));
  EXPECT_TRUE(holds(refusal(network(large), {{"pool", 0}}), "pool=4"));
  EXPECT_EQ(make_onnx(network(large), {{"pool", 4}})->spec().dimension, 3 * 4 * 4);
}

/// Doubles red, its weights in another file.
TinyOnnx outside(const std::vector<std::pair<std::string, std::string>>& place) {
  return TinyOnnx()
      .input({1, 3, 4, 4})
      .outside_weights("w", {1, 3, 1, 1}, place)
      .node("Conv", "conv", {"w"}, {{"kernel_shape", {1, 1}}});
}

TEST_F(Onnx, WeightsBesideTheModelAreReadFromItsFolderAlone) {
  const Folder other;
  const cv::Mat picture(4, 4, CV_8UC3, cv::Scalar(10, 20, 30));
  const auto encode = [&](const std::string& path) {
    return make_onnx(network(path), kBytes)->encode(std::span(&picture, 1))(0, 0);
  };
  const auto write = [](const std::string& path, float red) {
    make_file(path, "four" + TinyOnnx::raw({red, 0, 0}));
    return path;
  };
  const std::string data = write(folder / "a.onnx.data", 2), far = write(other / "far.data", 5);
  const auto at = [&](const std::string& location, const std::string& offset = "4", const std::string& length = "12") {
    return outside({{"location", location}, {"offset", offset}, {"length", length}}).save(folder / "a.onnx");
  };
  EXPECT_EQ(encode(at("a.onnx.data")), 60);
  EXPECT_EQ(encode(outside({{"location", "a.onnx.data"}, {"offset", "4"}}).save(folder / "a.onnx")), 60);
  const std::string before = make_onnx(network(at("./a.onnx.data")))->spec().name;
  write(data, 3);
  EXPECT_EQ(encode(folder / "a.onnx"), 90);
  EXPECT_NE(make_onnx(network(folder / "a.onnx"))->spec().name, before) << "other weights, another name";
  // A cache of models has links to files of other names.
  std::filesystem::create_directories(other / "cache");
  for (const std::string name : {"a.onnx", "a.onnx.data"})
    std::filesystem::create_symlink(folder / name, other / "cache/" + name);
  EXPECT_EQ(encode(other / "cache/a.onnx"), 90);

  const auto error = [&](const std::string& path) { return refusal(network(path)); };
  std::filesystem::create_symlink(far, folder / "link.data");
  for (const std::string& location :
       {far, "../" + std::filesystem::path(other.path()).filename().string() + "/far.data", std::string("link.data"),
        std::string("x/../a.onnx.data"), std::string()})
    EXPECT_TRUE(holds(error(at(location)), "outside its own folder, in '" + location + "'"));
  EXPECT_TRUE(holds(error(at("none.data")), "lacks the file of its weights, 'none.data'"));
  EXPECT_TRUE(holds(error(at(".")), "lacks the file"));
  EXPECT_TRUE(holds(error(at("a.onnx.data", "8")), "is cut short: weights 'w' are 12 bytes from byte 8 on"));
  EXPECT_TRUE(holds(error(at("a.onnx.data", "99")), "is cut short"));
  EXPECT_TRUE(holds(error(at("a.onnx.data", "4", "8")), "has 8 bytes of weights 'w', whose sides need 12"));
  EXPECT_TRUE(holds(error(at("a.onnx.data", "4", "-1")), "the length '-1'"));
  EXPECT_TRUE(holds(error(at("a.onnx.data", "4", "4294967296")), "is larger than 2 GiB"));
  EXPECT_TRUE(holds(error_of([&] { read_onnx(read_model_file(folder / "a.onnx", 1 << 20), "x"); }), "in other files"));
}

TEST_F(Onnx, SizeComesFromTheModelThenTheParametersThenThePreset) {
  const std::string fixed = tiny_convolution({1, 3, 6, 8}, 2).save(folder / "fixed.onnx");
  const std::string open = tiny_convolution({-1, 3, -1, -1}, 2).save(folder / "open.onnx");
  const auto size = [](const EncoderFiles& files, const Values& values = {}) {
    const std::string name = make_onnx(files, values)->spec().name;
    return name.substr(name.find("layer="));
  };
  EXPECT_TRUE(contains(size(network(fixed)), " 8x6 "));
  EXPECT_TRUE(contains(size(network(fixed, "", "resnet50")), " 8x6 ")) << "a preset only fills what is open";
  EXPECT_TRUE(contains(size(network(open, "", "resnet50")), " 224x224 "));
  EXPECT_TRUE(contains(size(network(open, "", "resnet50"), {{"width", 32}, {"height", 24}}), " 32x24 "));
  EXPECT_TRUE(contains(refusal(network(open)), "leaves the height of its input open"));
  EXPECT_TRUE(contains(refusal(network(fixed), {{"width", 10}}), "width of 8, not 10"));
}

TEST_F(Onnx, LayersAreFoundByNameOrSuggested) {
  const std::string path = tiny_convolution({1, 3, 6, 8}, 2).save(folder / "a.onnx");
  EXPECT_TRUE(contains(make_onnx(network(path, "relu"))->spec().name, "layer=" + layer_of("relu") + " "));
  EXPECT_TRUE(contains(make_onnx(network(path, "", "resnet50"))->spec().name, "layer=" + layer_of("pool") + " "));
  EXPECT_TRUE(contains(refusal(network(path, "REL")), "it has " + layer_of("relu")));
  const std::string none = refusal(network(path, "fc"));
  for (const std::string& part : {std::string("has no layer 'fc'"), std::string("its last are "), layer_of("pool")})
    EXPECT_TRUE(contains(none, part));
}

TEST_F(Onnx, NamesSayWhatChangesNumbers) {
  const std::string open = tiny_convolution({-1, 3, -1, -1}, 2).save(folder / "a.onnx");
  const std::string other = tiny_convolution({-1, 3, -1, -1}, 3).save(folder / "b.onnx");
  std::set<std::string> names;
  const auto add = [&](const EncoderFiles& files, Values values) {
    values.insert({{"width", 8}, {"height", 6}});
    const std::string name = make_onnx(files, values)->spec().name;
    EXPECT_LE(name.size(), 200u);
    EXPECT_TRUE(names.insert(name).second) << name;
  };
  add(network(open), {});
  add(network(other), {});
  add(network(open, "conv"), {});
  add(network(open, "conv"), {{"pool", 0}});
  add(network(open, "", "netvlad-vgg"), {});
  add(network(open), {{"width", 9}});
  add(network(open), {{"height", 9}});
  for (const char* name :
       {"scale", "mean-red", "mean-green", "mean-blue", "deviation-red", "deviation-green", "deviation-blue", "rgb"})
    add(network(open), {{name, name == std::string("rgb") ? 0 : 0.123456789}});

  const std::string long_name(300, 'x');
  const std::string path = TinyOnnx()
                               .input({1, 3, 4, 4})
                               .node("Relu", long_name + "1")
                               .node("Relu", long_name + "2")
                               .save(folder / "c.onnx");
  add(network(path, long_name + "1"), {{"width", 4}, {"height", 4}});
  add(network(path, long_name + "2"), {{"width", 4}, {"height", 4}});
}

TEST_F(Onnx, BadFilesGetOneLine) {
  const std::string good = tiny_convolution({1, 3, 6, 8}, 2).bytes();
  const auto write = [&](const std::string& bytes) {
    make_file(folder / "bad.onnx", bytes);
    return folder / "bad.onnx";
  };
  EXPECT_TRUE(contains(refusal(network("")), "--model"));
  EXPECT_TRUE(contains(refusal(network(folder / "none.onnx")), "No such file"));
  EXPECT_TRUE(contains(refusal(network(folder.path())), "is not a file"));
  EXPECT_TRUE(contains(refusal(network(write(""))), "empty file"));
  EXPECT_TRUE(contains(refusal(network(write("hello, I am no model at all"))), "not an ONNX model"));
  EXPECT_TRUE(contains(refusal(network(write("version https://git-lfs.github.com/spec/v1\n"))), "git lfs pull"));
  EXPECT_TRUE(contains(refusal(network(write(good), "", "vgg")), "known: cosplace"));
  for (std::size_t size = 1; size < good.size(); size += 5) {
    const std::string error = refusal(network(write(good.substr(0, size))));
    EXPECT_TRUE(holds(error, "bad.onnx: ")) << size;
  }
}

TEST_F(Onnx, ModelsThatAreNoPictureToVectorAreRefused) {
  const auto error = [&](const TinyOnnx& model) { return refusal(network(model.save(folder / "a.onnx"))); };
  EXPECT_TRUE(contains(error(TinyOnnx().input({1, 1, 6, 8}).node("Relu", "relu")), "picture of 3 channels"));
  EXPECT_TRUE(contains(error(TinyOnnx().input({1, 192}).node("Relu", "relu")), "picture of 3 channels"));
  EXPECT_TRUE(
      contains(error(TinyOnnx().input({1, 3, 6, 8}).input({1, 2}, "more").node("Relu", "relu")), "has 2 inputs"));
  EXPECT_TRUE(contains(error(TinyOnnx().input({1, 3, 9999, 8}).node("Relu", "relu")), "height of 9999"));
  EXPECT_TRUE(contains(error(TinyOnnx().input({1, 3, 6, 8})), "no operators"));

  ::testing::internal::CaptureStderr();
  const std::string unknown = error(TinyOnnx().input({1, 3, 6, 8}).node("Relu", "relu").node("Frobnicate", "strange"));
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "") << "OpenCV's own log";
  for (const char* part : {"strange", "Frobnicate"}) EXPECT_TRUE(holds(unknown, part));
  for (const char* part : {"no such operator", "in Python", "Debian 13"})
    EXPECT_TRUE(!by_opencv() || holds(unknown, part));

  ::testing::internal::CaptureStderr();
  const std::string wrong = error(TinyOnnx()
                                      .input({1, 3, 6, 8})
                                      .weights("kernel", {2, 5, 3, 3}, std::vector<float>(90))  // 5 channels, not 3
                                      .node("Conv", "conv", {"kernel"}, {{"kernel_shape", {3, 3}}}));
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  EXPECT_TRUE(holds(wrong, "a.onnx: "));

  // OpenCV 4.6 wants the bounds of Clip as attributes (opset 10), not as inputs (docs/how-to/use-an-onnx-encoder.md).
  const std::string clip =
      error(TinyOnnx().input({1, 3, 6, 8}).weights("least", {}, {0}).node("Clip", "clip", {"least"}));
  for (const char* part : {"clip', operator Clip: ", "input_size"})
    EXPECT_TRUE(onnx_library() != "OpenCV 4.6.0" || holds(clip, part));
}

TEST_F(Onnx, NumbersAreFiniteOrAnError) {
  const std::string path = tiny_convolution({1, 3, 6, 8}, 2).save(folder / "a.onnx");
  EXPECT_TRUE(contains(refusal(network(path), {{"deviation-red", 1e-40}}), "not finite"));
  EXPECT_TRUE(contains(refusal(network(path), {{"deviation-red", 1e-60}}), "not finite"));
}

TEST_F(Onnx, PicturesOfAnotherKindAreRefused) {
  const auto encoder = make_onnx(network(tiny_convolution({1, 3, 6, 8}, 2).save(folder / "a.onnx")));
  for (const cv::Mat& picture : {cv::Mat(6, 8, CV_8UC1), cv::Mat(6, 8, CV_32FC3), cv::Mat()})
    EXPECT_THROW(encoder->encode(std::span(&picture, 1)), Error);
}

TEST(OnnxBatches, ModelsThatCanTakeSeveralPicturesAtOnce) {
  if (by_opencv()) GTEST_SKIP() << "built without ONNX Runtime: " << onnx_library() << " runs pictures one by one";
  const Folder folder;
  std::vector<cv::Mat> pictures;
  for (int i = 0; i < 5; ++i) pictures.push_back(kFlat + cv::Scalar(0, 0, i));
  const auto expect = [&](const TinyOnnx& model, int batch) {
    const auto encoder = make_onnx(network(model.save(folder / "a.onnx")), kBytes);
    EXPECT_EQ(encoder->spec().batch, batch);
    const Eigen::MatrixXf found = encoder->encode(pictures);
    for (int i = 0; i < 5; ++i) EXPECT_EQ(found.col(i), Eigen::Vector3f(static_cast<float>(30 + i), 20, 10)) << i;
  };
  const auto pooled = [](std::int64_t batch) {
    return TinyOnnx().input({batch, 3, 4, 4}).node("GlobalAveragePool", "pool");
  };
  expect(pooled(-1), 8);
  expect(pooled(1), 4);  // one by one: any number is as good
  expect(pooled(3), 3);
  EXPECT_TRUE(holds(refusal(network(pooled(65).save(folder / "a.onnx"))), "takes 65 pictures at once"));
  expect(TinyOnnx()
             .input({-1, 3, 4, 4})
             .node("GlobalAveragePool", "pool")
             .integers("s", {1, -1})
             .node("Reshape", "r", {"s"}),
         4);
}

TEST(OnnxBatches, ModelsWhoseOutputHasAnotherLengthForEachPictureAreRefused) {
  if (by_opencv()) GTEST_SKIP() << "built without ONNX Runtime: " << onnx_library() << " has no operator NonZero";
  const Folder folder;
  const TinyOnnx places = TinyOnnx()
                              .input({1, 3, 4, 4})
                              .integers("sides", {1, -1})
                              .node("NonZero", "places")
                              .node("Cast", "cast", {}, {}, {{"to", 1}})
                              .node("Reshape", "row", {"sides"});
  const auto encoder = make_onnx(network(places.save(folder / "a.onnx")), kBytes);
  EXPECT_EQ(encoder->encode(std::span(&kFlat, 1)).rows(), 4 * 48);
  const cv::Mat dark(4, 4, CV_8UC3, cv::Scalar(10, 20, 0));
  EXPECT_TRUE(holds(error_of([&] { encoder->encode(std::span(&dark, 1)); }), "of one length"));
}

TEST(OnnxFile, DamageIsFoundWithoutACrash) {
  const std::string good = tiny_convolution({1, 3, 6, 8}, 2).bytes();
  const auto read = [](const std::string& text) {
    return read_onnx(std::as_bytes(std::span(text.data(), text.size())), "x");
  };
  EXPECT_EQ(read(good).nodes, 3);
  EXPECT_EQ(read(good).opset, 11);
  EXPECT_EQ(read(good).inputs.at(0).shape, (std::vector<std::int64_t>{1, 3, 6, 8}));
  cv::RNG random(5);
  int refused = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string bad = good;
    for (int n = random.uniform(1, 4); n > 0; --n)
      bad[static_cast<std::size_t>(random.uniform(0, static_cast<int>(bad.size())))] = static_cast<char>(random.next());
    try {
      read(bad);
      if (i % 20 == 0) refuse_misread_nodes(std::as_bytes(std::span(bad)), {1, 3, 6, 8}, "onnx_node!pool", "x");
    } catch (const Error&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 500);
}

TEST(OnnxNets, OsnetGivesWhatOpencvGives) {
  const std::string path = net("osnet_x0_25_msmt17.onnx");
  if (path.empty()) GTEST_SKIP() << "no osnet_x0_25_msmt17.onnx among the shared data";
  const auto encoder = make_onnx(network(path));
  EXPECT_EQ(encoder->spec().dimension, 512);
  std::vector<cv::Mat> pictures = {noise(128, 256, 1), noise(128, 256, 2), noise(128, 256, 3)};
  const Eigen::MatrixXf together = encoder->encode(pictures);
  for (int i = 0; i < 3; ++i) {
    const Eigen::VectorXf expected = bare(path, "", pictures[i]);
    EXPECT_LT((together.col(i) - expected).norm(), 1e-4f * expected.norm()) << i;
    EXPECT_TRUE(encoder->encode(std::span(&pictures[i], 1)).isApprox(together.col(i), by_opencv() ? 0 : 1e-5f)) << i;
  }
}

TEST(OnnxNets, ResnetIsCutAtItsPooledLayer) {
  const std::string path = net("resnet20.onnx");
  if (path.empty()) GTEST_SKIP() << "no resnet20.onnx among the shared data";
  const std::string layer = "onnx_node!GlobalAveragePool_70";
  const cv::Mat picture = noise(32, 32, 4);
  const Eigen::VectorXf expected = bare(path, layer, picture);
  ASSERT_EQ(expected.size(), 64);
  for (const EncoderFiles& files :
       {network(path, layer), network(path, "GlobalAveragePool_70"), network(path, "", "resnet50")}) {
    const Eigen::MatrixXf got = make_onnx(files)->encode(std::span(&picture, 1));
    ASSERT_EQ(got.rows(), 64);
    EXPECT_LT((got.col(0) - expected).norm(), 1e-4f * expected.norm());
  }
  EXPECT_EQ(make_onnx(network(path))->spec().dimension, 10);
  EXPECT_TRUE(contains(refusal(network(path), {{"width", 64}}), "width of 32, not 64"));
}

/// What PyTorch exported and computed: export_networks.py.
TEST(OnnxNets, NetworksOfToday) {
  const char* folder = std::getenv("CITYLEARN_NETWORKS");
  if (!folder) GTEST_SKIP() << "no CITYLEARN_NETWORKS: a folder that export_networks.py has filled";
  if (by_opencv()) GTEST_SKIP() << "built without ONNX Runtime: " << onnx_library() << " does not run them";
  cv::Mat picture(224, 224, CV_8UC3);
  for (int y = 0; y < 224; ++y)
    for (int x = 0; x < 224; ++x)
      for (int c = 0; c < 3; ++c)  // PyTorch's colours are red, green, blue
        picture.at<cv::Vec3b>(y, x)[2 - c] = static_cast<unsigned char>((31 * y + 17 * x + 101 * c + x * y) % 256);
  const std::vector<cv::Mat> several(3, picture);
  int networks = 0;
  for (const std::string& path : paths_in(folder)) {
    if (!path.ends_with(".onnx")) continue;
    ++networks;
    const std::string numbers = contents(path.substr(0, path.size() - 5) + ".f32");
    const Eigen::Map<const Eigen::VectorXf> wanted(reinterpret_cast<const float*>(numbers.data()),
                                                   numbers.size() / sizeof(float));
    const auto encoder = make_onnx(network(path));
    EXPECT_EQ(encoder->spec().batch, path.ends_with("-open.onnx") ? 8 : 4) << path;
    const Eigen::MatrixXf found = encoder->encode(several);
    ASSERT_EQ(found.rows(), wanted.size()) << path;
    for (int i = 0; i < 3; ++i)
      EXPECT_LT((found.col(i) - wanted).cwiseAbs().maxCoeff(), 1e-6f * std::max(1.0f, wanted.maxCoeff())) << path;
  }
  EXPECT_GE(networks, 18);
}

}  // namespace
}  // namespace citylearn::testing
