// SPDX-License-Identifier: Apache-2.0
// One file from a picture to an action, read by OpenCV's ONNX importer and run by its DNN module. tests/clients runs
// such a file in ONNX Runtime.
#include "tools/export/picture_export.h"

#include <gtest/gtest.h>
#include <onnx/checker.h>
#include <onnx/onnx_pb.h>

#include <filesystem>
#include <opencv2/dnn.hpp>
#include <set>

#include "core/files/files.h"
#include "encoder_service/pipeline/learned_files.h"
#include "tests/paths.h"
#include "tests/support/data/sample_pictures.h"
#include "tests/support/networks/picture_agent.h"
#include "tests/support/networks/some_agent.h"
#include "tests/support/networks/tiny_onnx.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"
#include "tools/export/encoder_graph.h"

namespace citylearn::testing {
namespace {

constexpr seconds kShortWait{60};

cv::dnn::Net read(const std::string& model) {
  cv::dnn::Net net = cv::dnn::readNetFromONNX(model.data(), model.size());
  net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
  return net;
}

/// 1 x 3 x height x width, red, green, blue.
cv::Mat planes(const cv::Mat& picture) { return cv::dnn::blobFromImage(picture, 1, {}, {}, /*swapRB=*/true); }

cv::Mat row(const std::vector<float>& numbers) { return cv::Mat(numbers, true).reshape(1, 1); }

Parameters parameters_of(const std::string& encoder, const std::map<std::string, double>& values) {
  return {encoder, EncoderRegistry::instance().find("encoder", encoder).parameters, values};
}

struct EncoderCase {
  std::string encoder;
  std::map<std::string, double> values;
  double rounding;  ///< allowed, of numbers of about 1
  bool network = false;
};
std::ostream& operator<<(std::ostream& out, const EncoderCase& one) { return out << one.encoder; }

class ExportedEncoder : public ::testing::TestWithParam<EncoderCase> {};
INSTANTIATE_TEST_SUITE_P(
    Encoders, ExportedEncoder,
    ::testing::Values(EncoderCase{"patchnorm", {}, 2e-4},
                      EncoderCase{"patchnorm", {{"width", 50}, {"height", 30}, {"patch", 7}}, 2e-4},
                      // A colour between two levels may round to either; normalised contrast enlarges that.
                      EncoderCase{"raw84", {{"sigma", 0}}, 1.01 / 255}, EncoderCase{"raw84", {}, 0.04},
                      EncoderCase{"onnx", {}, 2e-3, true}, EncoderCase{"onnx", {{"pool", 0}, {"rgb", 0}}, 0.05, true},
                      EncoderCase{"onnx", {{"pool", 3}}, 0.01, true}),
    [](const auto& one) { return one.param.encoder + std::to_string(one.index); });

TEST_P(ExportedEncoder, GivesTheEncodersDescriptors) {
  const EncoderCase& one = GetParam();
  Folder folder;
  EncoderFiles files;
  if (one.network)
    files = network(tiny_convolution({1, 3, 24, 32}, 6).save(folder / "net.onnx"),
                    one.values.contains("pool") ? "relu" : "pool");
  const Parameters parameters = parameters_of(one.encoder, one.values);
  const auto encoder = EncoderRegistry::instance().find("encoder", one.encoder).create(parameters, files);
  const int dimension = encoder->spec().dimension;
  for (const cv::Size size : {cv::Size(160, 96), cv::Size(32, 24), cv::Size(40, 20), cv::Size(301, 127)}) {
    OnnxGraph graph("encoder");
    const OnnxValue pixels = graph.input("picture", std::vector<std::int64_t>{3, size.height, size.width}, "");
    const OnnxValue descriptor = append_encoder({pixels, 3, size.width, size.height}, one.encoder, parameters, files);
    graph.output("descriptor", descriptor, dimension, "");
    graph.close_batch();
    const std::string bytes = graph.bytes("", {});
    onnx::ModelProto model;
    ASSERT_TRUE(model.ParseFromString(bytes));
    EXPECT_NO_THROW(onnx::checker::check_model(model));
    cv::dnn::Net net = read(bytes);
    for (std::uint64_t seed : {1, 2}) {
      const cv::Mat picture = drawn_picture(size.width, size.height, seed);
      net.setInput(planes(picture), "picture");
      const cv::Mat found = net.forward("descriptor");
      ASSERT_EQ(found.total(), static_cast<std::size_t>(dimension));
      const Eigen::VectorXf wanted = encoder->encode({&picture, 1}).col(0);
      const Eigen::Map<const Eigen::VectorXf> numbers(found.ptr<float>(), dimension);
      EXPECT_LT((numbers - wanted).cwiseAbs().maxCoeff(), one.rounding) << size;
      EXPECT_GT(wanted.norm(), 0.1f);
    }
  }
}

TEST(PictureExportFile, PaddingThatCountsIsTheSameForEveryReader) {
  const Folder folder;
  const TinyOnnx model = TinyOnnx()
                             .input({1, 3, 4, 4})
                             .producer("pytorch")
                             .node("AveragePool", "it", {}, {{"kernel_shape", {3, 3}}, {"pads", {1, 1, 1, 1}}},
                                   {{"count_include_pad", 1}});
  std::map<std::string, double> plain = {{"scale", 255}};
  for (const std::string colour : {"red", "green", "blue"})
    plain["mean-" + colour] = 0, plain["deviation-" + colour] = 1;
  OnnxGraph graph("encoder");
  const OnnxValue pixels = graph.input("picture", std::vector<std::int64_t>{3, 4, 4}, "");
  graph.output(
      "descriptor",
      append_encoder({pixels, 3, 4, 4}, "onnx", parameters_of("onnx", plain), network(model.save(folder / "net.onnx"))),
      3, "");
  graph.close_batch();
  onnx::ModelProto proto;
  ASSERT_TRUE(proto.ParseFromString(graph.bytes("", {})));
  EXPECT_NO_THROW(onnx::checker::check_model(proto));
  // Of 4 x 4 places four have 4 of 9 numbers within the picture, eight 6 and four all.
  const float inside = (4 * 4 + 8 * 6 + 4 * 9) / 9.0f / 16;
  for (const std::string producer : {"citylearn", "pytorch"}) {
    proto.set_producer_name(producer);
    cv::dnn::Net net = read(proto.SerializeAsString());
    net.setInput(planes(cv::Mat(4, 4, CV_8UC3, cv::Scalar(10, 20, 30))), "picture");
    const cv::Mat found = net.forward("descriptor");
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(found.ptr<float>()[c], static_cast<float>(30 - 10 * c) * inside, 1e-4f) << producer;
  }
}

/// An exported file in OpenCV, given what the services' agent saw, takes the same actions.
void expect_same_actions(const PictureAgent& agent, const std::string& model) {
  cv::dnn::Net net = read(model);
  onnx::ModelProto proto;
  ASSERT_TRUE(proto.ParseFromString(model));
  std::map<std::string, int> widths;
  for (const auto& input : proto.graph().input())
    widths[input.name()] = static_cast<int>(input.type().tensor_type().shape().dim(1).dim_value());
  const std::vector<cv::String> outputs = net.getUnconnectedOutLayersNames();
  std::map<std::string, cv::Mat> kept;  // what comes back as an input
  for (const std::string name : {"state", "condition", "seen"})
    if (widths.contains(name)) kept[name] = cv::Mat::zeros(1, widths[name], CV_32F);
  const auto run = [&](int frame, int goal, int previous, unsigned allowed, bool first) {
    net.setInput(planes(agent.season_picture(frame)), "picture");
    net.setInput(row({static_cast<float>(goal)}), "goal");
    std::vector<float> one_hot(kActions), mask(kActions);
    for (int i = 0; i < kActions; ++i) {
      one_hot[static_cast<std::size_t>(i)] = previous == i;
      mask[static_cast<std::size_t>(i)] = static_cast<float>(allowed >> i & 1);
    }
    net.setInput(row(one_hot), "previous_action");
    net.setInput(row(mask), "allowed");
    net.setInput(row({static_cast<float>(first)}), "first");
    for (const auto& [name, value] : kept) net.setInput(value, name);
    std::vector<cv::Mat> all;
    net.forward(all, outputs);
    std::map<std::string, cv::Mat> named;
    for (std::size_t i = 0; i < outputs.size(); ++i) named[outputs[i]] = all[i].clone();
    return named;
  };
  // The encoder_service takes the traversal's frames in their order, whatever the agent does.
  std::vector<cv::Mat> seen;
  for (int frame = 0; widths.contains("seen") && frame < PictureAgent::kFrames; ++frame) {
    seen.push_back(kept["seen"]);
    kept["seen"] = run(frame, 0, kNoAction, 7, true).at("next_seen");
  }
  const std::vector<ServiceStep> steps = agent.long_steps(30);
  int number = 0;
  for (const ServiceStep& step : steps) {
    if (!seen.empty()) kept["seen"] = seen[static_cast<std::size_t>(step.frame)];
    const auto found = run(step.frame, step.goal, step.previous, step.allowed, step.first);
    const cv::Mat features = found.at("features");
    const std::span<const float> wanted = agent.features(step.frame);
    ASSERT_EQ(features.total(), wanted.size());
    for (std::size_t i = 0; i < wanted.size(); ++i)
      EXPECT_NEAR(features.ptr<float>()[i], wanted[i], 2e-3) << "step " << number;
    const float* logits = found.at("logits").ptr<float>();
    EXPECT_EQ(drawn_action(logits, step.random), step.action) << "step " << number << " of " << steps.size();
    EXPECT_EQ(found.at("action").ptr<float>()[0],
              static_cast<float>(std::max_element(logits, logits + kActions) - logits));
    kept["state"] = found.at("next_state");
    if (widths.contains("condition")) kept["condition"] = found.at("next_condition");
    ++number;
  }
}

struct AgentCase {
  std::string agent, encoder;
  Centring centring;
  int updates;
};
std::ostream& operator<<(std::ostream& out, const AgentCase& one) { return out << one.agent << " " << one.encoder; }

class PictureExport : public ::testing::TestWithParam<AgentCase> {};
INSTANTIATE_TEST_SUITE_P(Agents, PictureExport,
                         ::testing::Values(AgentCase{"place_filter", "patchnorm", Centring::kRunning, 16},
                                           AgentCase{"features", "patchnorm", Centring::kReference, 16},
                                           AgentCase{"place_filter", "onnx", Centring::kRunning, 8}),
                         [](const auto& one) { return one.param.agent + "_" + one.param.encoder; });

TEST_P(PictureExport, ActsAsTheServicesDoOverEpisodes) {
  Folder folder;
  EncoderFiles files;
  if (GetParam().encoder == "onnx")
    files = network(tiny_convolution({1, 3, 48, 80}, 32).save(folder / "net.onnx"), "pool");
  const PictureAgent agent(GetParam().agent, GetParam().encoder, {}, files, GetParam().centring, GetParam().updates);
  const std::string model = agent.exported(folder);
  onnx::ModelProto proto;
  ASSERT_TRUE(proto.ParseFromString(model));
  EXPECT_NO_THROW(onnx::checker::check_model(proto));
  expect_same_actions(agent, model);
}

/// A checkpoint of some agent that learned with patchnorm, in a folder with its reduction.
struct SomeExport {
  Folder folder;
  PictureExportOptions options;

  explicit SomeExport(const std::string& recipe, const std::string& agent = "place_filter") {
    options.agent = {folder / "one.clk", "", folder / "one.onnx"};
    Checkpoint checkpoint = some_checkpoint(agent, some_task());
    checkpoint.header["data"] = {{"train", "summer,winter"},
                                 {"traversals", {{"summer", {{"hash", "00000000000000ab"}, {"encoder", recipe}}}}}};
    write_checkpoint(options.agent.checkpoint, checkpoint);
    options.encoder = "patchnorm";
    options.picture = {160, 96};
    options.store = folder / "store";
    std::filesystem::create_directory(options.store);
    store_reduction(12, kPatchnorm, reduction_path(options.store, kPatchnorm, 0xAB, {.dimension = 12}));
  }
  static void store_reduction(int dimension, const std::string& encoder, const std::string& path) {
    const Bytes bytes = Reduction::learn(Eigen::MatrixXf::Random(2048, 20), {.dimension = dimension}).save(encoder);
    write_file(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  }
  std::string error() const {
    return error_of([&] { export_picture_agent(options); });
  }

  static inline const std::string kPatchnorm = "patchnorm-1 height=32 patch=8 width=64";
};

const std::string kRecipe = SomeExport::kPatchnorm + " | 64 running 0.2 of 00000000000000ab";

TEST(PictureExportFile, SaysWhatItIs) {
  SomeExport some(kRecipe);
  some.options.encoder.clear();  // the checkpoint names it
  export_picture_agent(some.options);
  const std::string bytes = read_file(some.folder / "one.onnx");
  export_picture_agent(some.options);
  EXPECT_EQ(read_file(some.folder / "one.onnx"), bytes) << "the same inputs, the same bytes";
  onnx::ModelProto model;
  ASSERT_TRUE(model.ParseFromString(bytes));
  std::map<std::string, std::string> metadata;
  for (const auto& entry : model.metadata_props()) metadata[entry.key()] = entry.value();
  EXPECT_EQ(metadata["agent"], "place_filter");
  EXPECT_EQ(metadata["encoder"], kRecipe);
  std::set<std::string> inputs, outputs;
  for (const auto& input : model.graph().input()) inputs.insert(input.name());
  for (const auto& output : model.graph().output()) outputs.insert(output.name());
  EXPECT_EQ(inputs, (std::set<std::string>{"picture", "seen", "condition", "goal", "previous_action", "allowed",
                                           "first", "state"}));
  EXPECT_EQ(outputs, (std::set<std::string>{"action", "logits", "value", "features", "next_state", "next_condition",
                                            "next_seen"}));
  some.options.reduction_file = reduction_path(some.options.store, SomeExport::kPatchnorm, 0xAB, {.dimension = 12});
  some.options.store.clear();
  EXPECT_EQ(some.error(), "") << "the reduction's own file";
}

TEST(PictureExportFile, OneClearLineWhereThingsDoNotFit) {
  const auto expect = [](const std::string& error, const std::vector<std::string>& words) {
    EXPECT_EQ(occurrences(error, "\n"), 0) << error;
    for (const std::string& word : words) EXPECT_TRUE(contains(error, word)) << word << ": " << error;
  };
  SomeExport some(kRecipe);
  const PictureExportOptions right = some.options;
  const auto expect_error = [&](const std::vector<std::string>& words) {
    expect(some.error(), words);
    some.options = right;
  };
  some.options.encoder = "eye";
  expect_error({"unknown encoder 'eye'", "patchnorm"});
  some.options.encoder = "hog_vlad";
  expect_error({"'hog_vlad' cannot be written as ONNX operators", "onnx, patchnorm, raw84"});
  some.options.encoder = "raw84";
  expect_error({"raw84-2 sigma=4", "one.clk", "learned with '" + SomeExport::kPatchnorm + "'"});
  some.options.parameters["patchnorm"]["width"] = 32;
  expect_error({"width=32", "width=64"});
  some.options.encoder = "onnx";
  expect_error({"--model"});
  some.options.files.model = some.folder / "none.onnx";
  some.options.encoder = "onnx";
  expect_error({"none.onnx"});
  some.options.agent.checkpoint = some.folder / "none.clk";
  expect_error({"none.clk"});
  some.options.agent.output = some.folder / "one.safetensors";
  expect_error({"--output", "one.safetensors"});
  some.options.reduction_file = some.folder / "none.reduction";
  expect_error({"none.reduction"});
  some.options.store.clear();
  expect_error({"64 running 0.2 of 00000000000000ab", "--store"});
  some.options.store = some.folder / "";
  expect_error({"no reduction", "--store", "--reduction"});
  const std::string other = some.folder / "other.reduction";
  SomeExport::store_reduction(8, SomeExport::kPatchnorm, other);
  some.options.reduction_file = other;
  expect_error({"gives 8 features", "takes 12"});
  SomeExport::store_reduction(12, "patchnorm-1 height=16 patch=8 width=64", other);
  some.options.reduction_file = other;
  expect_error({"other.reduction", "height=16"});

  expect(SomeExport(SomeExport::kPatchnorm + " | mine.reduction").error(), {"--reduction", "mine.reduction"});
  expect(SomeExport(SomeExport::kPatchnorm + " | 12 own 0.2").error(), {"'own'", "running"});
  expect(SomeExport("").error(), {"one.clk", "names no encoder"});
  expect(SomeExport(kRecipe, "baseline").error(), {"baseline", "does not look at pictures"});
  for (const std::string text : {"", "160", "160x", "0x96", "160x96x3", "160x5000", "ax96"})
    expect(error_of([&] { picture_size(text); }), {"--picture"});
}

TEST(PictureExportFile, NetworksThatDoNotFitAreNamed) {
  OnnxGraph graph("picture");
  const OnnxValue pixels = graph.input("picture", std::vector<std::int64_t>{3, 8, 8}, "");
  const std::string model = tiny_convolution({1, 3, 8, 8}, 2).bytes();
  const auto error = [&](const std::string& bytes, const std::string& node) {
    return error_of([&] { graph.append_network(bytes, pixels, node, "net.onnx"); });
  };
  EXPECT_TRUE(contains(error("no model", "pool"), "net.onnx"));
  EXPECT_TRUE(contains(error(model, "nowhere"), "no node 'nowhere'"));
  onnx::ModelProto proto;
  ASSERT_TRUE(proto.ParseFromString(model));
  proto.mutable_opset_import(0)->set_version(9);
  EXPECT_TRUE(contains(error(proto.SerializeAsString(), "pool"), "opset 9"));
  proto.mutable_opset_import(0)->set_version(11);
  proto.add_opset_import()->set_domain("com.example");
  EXPECT_TRUE(contains(error(proto.SerializeAsString(), "pool"), "com.example"));
}

TEST(ExportProgram, WritesTheFileOrSaysWhyNot) {
  SomeExport some(kRecipe);
  const auto run = [&](const std::string& output, const std::vector<std::string>& more) {
    std::vector<std::string> command = {CITYLEARN_EXPORT, "--checkpoint", some.options.agent.checkpoint};
    if (!output.empty()) command.insert(command.end(), {"--output", some.folder / output});
    command.insert(command.end(), more.begin(), more.end());
    Service program(command, some.folder / "log");
    const auto status = program.wait(kShortWait);
    return std::pair{status.value_or(-1), program.output()};
  };
  const std::vector<std::string> picture = {"--picture", "160x96", "--store", some.options.store};
  EXPECT_EQ(run("2.onnx", picture).first, 0);
  EXPECT_TRUE(std::filesystem::exists(some.folder / "2.onnx"));
  const auto [status, output] = run("2.onnx", {"--picture", "160x96", "--encoder", "hog"});
  EXPECT_EQ(status, 1);
  EXPECT_TRUE(contains(output, "'hog' cannot be written")) << output;
  EXPECT_EQ(occurrences(output, "\n"), 1) << output;
  // Without a picture, the agent alone.
  EXPECT_EQ(run("one.onnx", {}).first, 0);
  EXPECT_EQ(run("one.safetensors", {}).first, 0);
  EXPECT_EQ(run("again.onnx", {"--parameters", some.folder / "one.safetensors"}).first, 0);
  onnx::ModelProto one, again;
  ASSERT_TRUE(one.ParseFromString(read_file(some.folder / "one.onnx")));
  ASSERT_TRUE(again.ParseFromString(read_file(some.folder / "again.onnx")));
  EXPECT_EQ(one.graph().SerializeAsString(), again.graph().SerializeAsString()) << "its own parameters, read back";
  const auto [refused, why] = run("", {});
  EXPECT_NE(refused, 0);
  EXPECT_TRUE(contains(why, "--output")) << why;
}

}  // namespace
}  // namespace citylearn::testing
