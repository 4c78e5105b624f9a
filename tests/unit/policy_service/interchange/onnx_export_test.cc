// SPDX-License-Identifier: Apache-2.0
// Exported models, read by OpenCV's ONNX importer and run by its DNN module: a reader and an arithmetic that share no
// code with ours. The ONNX project's own checker says whether they keep to the standard.
#include <gtest/gtest.h>
#include <onnx/checker.h>
#include <onnx/onnx_pb.h>
#include <onnx/shape_inference/implementation.h>

#include <cmath>
#include <filesystem>
#include <opencv2/dnn.hpp>
#include <set>

#include "core/files/files.h"
#include "policy_service/interchange/agent_graph.h"
#include "policy_service/interchange/export.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/network/feature_normaliser.h"
#include "tests/support/files.h"
#include "tests/support/networks/some_agent.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr int kExportedSteps = 12, kExportedAgents = 3;

Parameters parameters_for(const std::string& name, const std::map<std::string, double>& values) {
  return {name, NetworkRegistry<float>::instance().find("network", name).parameters, values};
}

/// Returns random inputs of all agents at one step, with episodes that begin in the middle.
NetworkInputs<float> some_step(const NetworkTask& task, int step, Random& random) {
  NetworkInputs<float> inputs;
  inputs.resize(task.features, 1, kExportedAgents);
  inputs.frames = task.frames;
  for (int b = 0; b < kExportedAgents; ++b) {
    const auto index = static_cast<std::size_t>(b);
    inputs.first[index] = step == 0 || (step == 4 && b == 1) || (step == 9 && b != 1);
    // The route's ends come up often: their masks differ.
    inputs.position[index] =
        random.below(3) ? static_cast<int>(random.below(task.frames)) : (b % 2) * (task.frames - 1);
    inputs.goal[index] = step == 3 ? 0 : step == 4 ? task.frames - 1 : static_cast<int>(random.below(task.frames));
    inputs.previous_action[index] =
        inputs.first[index] ? std::uint8_t{kNoAction} : static_cast<std::uint8_t>(random.below(kActions));
    const int position = inputs.position[index];
    inputs.allowed[index] = position == 0 ? 0b011 : position == task.frames - 1 ? 0b101 : 0b111;
    Vector<float> seen = task.reference.col(position);
    for (float& value : seen) value += static_cast<float>(0.1 * random.normal());
    inputs.see(b, -1, seen);
  }
  return inputs;
}

/// The exported model in OpenCV, for batches of `count` agents.
class Reader {
 public:
  Reader(const std::string& model, int count) {
    onnx::ModelProto proto;
    EXPECT_TRUE(proto.ParseFromString(model));
    for (auto& input : *proto.mutable_graph()->mutable_input()) {
      inputs_.insert(input.name());
      input.mutable_type()->mutable_tensor_type()->mutable_shape()->mutable_dim(0)->set_dim_value(count);
    }
    const std::string closed = proto.SerializeAsString();
    net_ = cv::dnn::readNetFromONNX(closed.data(), closed.size());
    net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
  }

  /// Runs all agents at once when `agent` < 0. `state`: size x agents.
  std::vector<cv::Mat> step(const NetworkInputs<float>& inputs, const Vector<float>& condition,
                            const Matrix<float>& state, int agent) {
    const int begin = agent < 0 ? 0 : agent, count = agent < 0 ? inputs.agents : 1;
    const auto give = [&](const std::string& name, int width, const auto& value) {
      if (!inputs_.contains(name)) return;
      cv::Mat rows(count, width, CV_32F);
      for (int b = 0; b < count; ++b)
        for (int i = 0; i < width; ++i)
          rows.at<float>(b, i) = static_cast<float>(value(static_cast<std::size_t>(begin + b), i));
      net_.setInput(rows, name);
    };
    give("features", static_cast<int>(inputs.features.rows()),
         [&](std::size_t b, int i) { return inputs.features_of(static_cast<std::ptrdiff_t>(b))(i); });
    give("condition", static_cast<int>(condition.size()), [&](std::size_t, int i) { return condition(i); });
    give("goal", 1, [&](std::size_t b, int) { return inputs.goal[b]; });
    give("position", 1, [&](std::size_t b, int) { return inputs.position[b]; });
    give("previous_action", kActions, [&](std::size_t b, int i) { return inputs.previous_action[b] == i; });
    give("allowed", kActions, [&](std::size_t b, int i) { return inputs.allowed[b] >> i & 1; });
    give("first", 1, [&](std::size_t b, int) { return inputs.first[b]; });
    give("state", static_cast<int>(state.rows()),
         [&](std::size_t b, int i) { return state(i, static_cast<std::ptrdiff_t>(b)); });
    std::vector<cv::Mat> outputs;
    net_.forward(outputs, std::vector<cv::String>{"logits", "value", "next_state"});
    return outputs;
  }
  const std::set<std::string>& inputs() const { return inputs_; }

 private:
  std::set<std::string> inputs_;
  cv::dnn::Net net_;
};

struct Case {
  std::string name;
  std::map<std::string, double> values = {};
  int features = 64, frames = 128;
  double rounding = 1e-5;  // allowed, of numbers up to 1
  int experiences = 1;     // of each place
  int places = 0;          // of streets; 0: a line

  NetworkTask task() const {
    NetworkTask task = some_task(features, frames, experiences);
    task.goals = places;
    return task;
  }
};
std::ostream& operator<<(std::ostream& out, const Case& one) { return out << one.name; }

/// place_filter's scores reach 1,000 below zero, where a float's last bit is 6e-5; the belief is off by a few of them.
constexpr double kOfScores = 2.5e-4;

/// Every exporter with its network as it is by default, and other forms of some.
std::vector<Case> cases() {
  std::vector<Case> all;
  for (const auto* entry : AgentGraphRegistry::instance().entries()) {
    const bool pictures = entry->name == "raw_images";
    if (pictures)  // three layers more, of sums over up to 2,592 numbers
      all.push_back({entry->name, {}, 84 * 84 * 3, 16, 5e-5});
    else if (entry->name == "place_filter")
      all.push_back({entry->name, {}, 64, 128, kOfScores});
    else
      all.push_back({entry->name});
  }
  all.push_back({"features", {{"hidden", 20}, {"cells", 7}, {"relu", 0}, {"mask-input", 0}}, 12, 9});
  all.push_back({"place_filter", {{"units", 5}}, 12, 2, kOfScores});
  all.push_back({"place_filter", {{"slip", 0}}, 64, 128, kOfScores});
  all.push_back({"place_filter", {{"slip", 0.2}, {"kidnap", 0.01}}, 12, 9, kOfScores});
  all.push_back({"place_filter", {}, 16, 24, kOfScores, 3});
  all.push_back({"features", {}, 16, 24, 1e-5, 2});
  for (const char* walker : {"features", "baseline"}) all.push_back({walker, {}, 12, 13, 1e-5, 1, 7});
  return all;
}

class OnnxExport : public ::testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Networks, OnnxExport, ::testing::ValuesIn(cases()),
                         [](const auto& one) { return one.param.name + std::to_string(one.index); });

void compare(const cv::Mat& found, int row, const Eigen::Ref<const Vector<float>>& expected, double rounding,
             const std::string& what) {
  ASSERT_EQ(found.dims, 2) << what;
  ASSERT_EQ(found.cols, expected.size()) << what;
  for (int i = 0; i < found.cols; ++i)
    EXPECT_NEAR(found.at<float>(row, i), expected(i), rounding * std::max(1.0f, std::abs(expected(i))))
        << what << " " << i;
}

TEST_P(OnnxExport, OpenCvComputesTheSameOverEpisodes) {
  const NetworkTask task = GetParam().task();
  const TrainedAgent agent = some_agent(GetParam().name, task, GetParam().values);
  const std::string model = onnx_bytes(agent, parameters_for(agent.name, GetParam().values), {});
  // Its own state each: errors may add up from step to step, and must not.
  for (const bool together : {true, false}) {
    Reader reader(model, together ? kExportedAgents : 1);
    Random random{9};
    const FeatureNormaliser normaliser(task.reference);
    SeenFeatures seen;
    const auto workspace = agent.network->make_workspace();
    // Whatever is in the state at first must not matter.
    Matrix<float> state = Matrix<float>::Constant(agent.network->state_size(), kExportedAgents, 0.3f), theirs = state;
    for (int step = 0; step < kExportedSteps; ++step) {
      const NetworkInputs<float> inputs = some_step(task, step, random);
      NetworkInputs<float> normalised = inputs;
      if (agent.network->normalises()) {
        for (int b = 0; b < kExportedAgents; ++b) seen.see(inputs.features_of(b));
        normaliser.apply(normalised.features.leftCols(normalised.distinct), seen);
      }
      agent.network->forward(agent.parameters, normalised, state, *workspace);
      state = workspace->state;
      const Matrix<float> before = theirs;
      for (int b = 0; b < kExportedAgents; ++b) {
        if (together && b > 0) break;
        const std::vector<cv::Mat> outputs = reader.step(inputs, seen.numbers(), before, together ? -1 : b);
        const int rows = together ? kExportedAgents : 1;
        for (int row = 0; row < rows; ++row) {
          const int column = together ? row : b;
          const std::string what = "step " + std::to_string(step) + ", agent " + std::to_string(column);
          ASSERT_EQ(outputs[0].rows, rows) << what;
          compare(outputs[0], row, workspace->heads.logits.col(column), GetParam().rounding, what + ", logits");
          compare(outputs[1], row, workspace->heads.values.col(column), GetParam().rounding, what + ", value");
          compare(outputs[2], row, state.col(column), GetParam().rounding, what + ", state");
          for (std::ptrdiff_t i = 0; i < state.rows(); ++i)
            theirs(i, column) = outputs[2].at<float>(row, static_cast<int>(i));
        }
      }
      if (HasFailure()) return;
    }
  }
}

TEST_P(OnnxExport, KeepsToTheStandard) {
  const NetworkTask task = GetParam().task();
  const TrainedAgent agent = some_agent(GetParam().name, task, GetParam().values);
  const Parameters parameters = parameters_for(agent.name, GetParam().values);
  const std::string bytes = onnx_bytes(agent, parameters, {{"agent", agent.name}});
  EXPECT_EQ(bytes, onnx_bytes(agent, parameters, {{"agent", agent.name}})) << "the same agent, the same bytes";
  onnx::ModelProto model;
  ASSERT_TRUE(model.ParseFromString(bytes));
  EXPECT_NO_THROW(onnx::checker::check_model(model));
  ASSERT_EQ(model.opset_import_size(), 1);
  EXPECT_EQ(model.opset_import(0).version(), OnnxGraph::kOpset);
  // Every operator's shapes fit: strict, an error where they don't; and what comes out is what was declared.
  for (auto& output : *model.mutable_graph()->mutable_output()) output.mutable_type()->Clear();
  onnx::shape_inference::InferShapes(model, onnx::OpSchemaRegistry::Instance(), {true, 1});
  const std::map<std::string, int> widths = {
      {"logits", kActions}, {"value", 1}, {"next_state", agent.network->state_size()}};
  ASSERT_EQ(model.graph().output_size(), 3);
  for (const auto& output : model.graph().output()) {
    const auto& shape = output.type().tensor_type().shape();
    ASSERT_EQ(shape.dim_size(), 2) << output.name();
    EXPECT_EQ(shape.dim(1).dim_value(), widths.at(output.name())) << output.name();
  }
}

TEST(OnnxExportFile, TellsWhatItIs) {
  Folder folder;
  const NetworkTask task = some_task();
  write_checkpoint(folder / "one.clk", some_checkpoint("features", task));
  export_agent({folder / "one.clk", "", folder / "one.onnx"});
  onnx::ModelProto model;
  ASSERT_TRUE(model.ParseFromString(read_file(folder / "one.onnx")));
  std::map<std::string, std::string> metadata;
  for (const auto& entry : model.metadata_props()) metadata[entry.key()] = entry.value();
  EXPECT_EQ(metadata["agent"], "features");
  EXPECT_EQ(metadata["frames"], "9");
  EXPECT_EQ(metadata["first_frame"], "5");
  EXPECT_EQ(metadata["features"], "12");
  EXPECT_EQ(metadata["checkpoint_sha256"].size(), 64u);
  EXPECT_TRUE(contains(metadata["network"], "\"cells\""));
  EXPECT_EQ(std::filesystem::file_size(folder / "one.onnx"), read_file(folder / "one.onnx").size());
}

TEST(OnnxExportFile, OneClearLineWhereThereIsNoExporterOrNoFormat) {
  const NetworkTask task = some_task();
  TrainedAgent agent = some_agent("baseline", task);
  const Parameters parameters = parameters_for("baseline", {});
  agent.name = "something_new";
  const std::string refusal = error_of([&] { export_graph(agent, parameters); });
  EXPECT_TRUE(contains(refusal, "'something_new' has no ONNX exporter"));
  EXPECT_TRUE(contains(refusal, "place_filter"));
  agent.name = "baseline";  // an exporter that no longer fits its network
  EXPECT_THROW(AgentGraph(agent).tensor("no.such.tensor"), Error);
  Folder folder;
  write_checkpoint(folder / "one.clk", some_checkpoint("baseline", task));
  for (const std::string output : {"", "one", "one.pt"})
    EXPECT_THROW(export_agent({folder / "one.clk", "", output}), Error) << output;
  EXPECT_THROW(export_agent({"", "", folder / "one.onnx"}), Error);
  EXPECT_THROW(export_agent({folder / "none.clk", "", folder / "one.onnx"}), Error);
}

}  // namespace
}  // namespace citylearn::testing
