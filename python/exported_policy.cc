// SPDX-License-Identifier: Apache-2.0
// Exported agents, run by OpenCV's DNN module.
#include <charconv>
#include <opencv2/dnn.hpp>

#include "encoder_service/onnx/onnx_file.h"
#include "policy_service/rollout/evaluated_tasks.h"
#include "policy_service/rollout/network_policy.h"
#include "policy_service/run/evaluation.h"
#include "python/evaluation.h"

namespace citylearn::python {
namespace {

constexpr std::uint64_t kMaxModelBytes = std::uint64_t{1} << 31;
constexpr auto kColumns = EvaluatedTasks::kColumns;

/// Draws the actions that NetworkPolicy draws, from the model's logits.
class OnnxPolicy : public Policy {
 public:
  OnnxPolicy(const ExportedPolicy& policy, std::uint64_t seed)
      : policy_(policy),
        seed_(seed),
        net_(cv::dnn::readNetFromONNX(reinterpret_cast<const char*>(policy.model.data()), policy.model.size())) {
    net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
  }

  void begin(std::uint32_t first_task, const SeenFeatures& known) override { tasks_.begin(first_task, known); }
  std::map<std::uint32_t, SeenFeatures> seen() const override { return tasks_.seen(); }

  void act(const msg::Observation& seen, std::vector<std::uint8_t>& choice) override {
    choice.assign(seen.goal().size(), 0);
    states_.resize(choice.size());
    random_.resize(choice.size());
    tasks_.follow(seen);
    for (const EvaluatedTasks::Batch& batch : tasks_.batches()) act(seen, batch, choice);
  }

 private:
  void act(const msg::Observation& seen, const EvaluatedTasks::Batch& batch, std::vector<std::uint8_t>& choice) {
    const int features = policy_.features > 0 ? policy_.features : static_cast<int>(seen.feature_dimension());
    read_observation(seen, {.features = features, .reference = {}}, policy_.first_frame, policy_.frames, true, inputs_,
                     batch);
    std::map<std::string, cv::Mat> rows;
    for (const auto& [name, width] : policy_.inputs) rows[name] = cv::Mat::zeros(kColumns, width, CV_32F);
    EvaluatedTasks::each_agent(batch, [&](int column, int agent) {
      const auto c = static_cast<std::size_t>(column), a = static_cast<std::size_t>(agent);
      const auto give = [&](const char* name, const auto& numbers) {
        const auto found = rows.find(name);
        if (found == rows.end()) return;
        Eigen::Map<Vector<float>>(found->second.ptr<float>(column), found->second.cols) = numbers;
      };
      const auto bits = [](auto of) { return Eigen::Vector3f(of(0), of(1), of(2)); };
      const auto number = [](int value) { return Vector<float>::Constant(1, static_cast<float>(value)); };
      if (inputs_.first[c]) {
        states_[a] = cv::Mat();
        random_[a] = Random{seed_, tasks_.task(agent)};
      }
      Vector<float> own = inputs_.features_of(column);
      if (rows.contains("condition")) {
        tasks_.normalise(FeatureNormaliser(), agent, own);  // notes what is seen
        give("condition", tasks_.total().numbers());
      }
      give("features", own);
      give("goal", number(inputs_.goal[c]));
      give("position", number(inputs_.position[c]));
      give("previous_action", bits([&](int i) { return static_cast<float>(inputs_.previous_action[c] == i); }));
      give("allowed", bits([&](int i) { return static_cast<float>(inputs_.allowed[c] >> i & 1); }));
      give("first", number(inputs_.first[c]));
      if (!states_[a].empty()) states_[a].copyTo(rows.at("state").row(column));
    });
    for (const auto& [name, values] : rows) net_.setInput(values, name);
    std::vector<cv::Mat> outputs;
    net_.forward(outputs, std::vector<cv::String>{"logits", "next_state"});
    EvaluatedTasks::each_agent(batch, [&](int column, int agent) {
      const auto a = static_cast<std::size_t>(agent);
      float log_probability = 0;
      choice[a] =
          sample_action(Eigen::Map<const Eigen::Vector3f>(outputs[0].ptr<float>(column)), random_[a], log_probability);
      states_[a] = outputs[1].row(column).clone();
    });
  }

  const ExportedPolicy policy_;
  const std::uint64_t seed_;
  cv::dnn::Net net_;
  EvaluatedTasks tasks_;
  NetworkInputs<float> inputs_;
  std::vector<cv::Mat> states_;  // by agent
  std::vector<Random> random_;   // by agent, of its task
};

}  // namespace

ExportedPolicy::ExportedPolicy(const std::string& path)
    : model(with_batch(read_model_file(path, kMaxModelBytes), kColumns, path)) {
  const OnnxFile file = read_onnx(model, path);
  const auto number = [&](const std::string& key) {
    const auto found = file.metadata.find(key);
    int value = 0;
    if (found != file.metadata.end())
      std::from_chars(found->second.data(), found->second.data() + found->second.size(), value);
    return value;
  };
  for (const OnnxFile::Input& input : file.inputs)
    if (input.shape.size() == 2) inputs[input.name] = static_cast<int>(input.shape[1]);
  frames = number("frames");
  first_frame = number("first_frame");
  if (!file.metadata.contains("agent") || frames < 2 || !inputs.contains("goal") || !inputs.contains("state"))
    throw Error("is not an agent that citylearn export wrote", path, "one that takes features");
  name = file.metadata.at("agent");
  if (const auto found = file.metadata.find("data"); found != file.metadata.end())
    data = TrainingData::parse(found->second, path);
  places = number("places");
  features = inputs.contains("features") ? inputs.at("features") : 0;
}

std::unique_ptr<Policy> exported_policy(const ExportedPolicy& policy, std::uint64_t seed, const Streets& on) {
  require_kind(policy.places, on);
  if (on.states && (on.states->places() != policy.places || on.states->states() != policy.frames))
    throw Error("learned on other streets, of " + std::to_string(policy.places) + " places", "policy",
                "load its checkpoint instead of the model");
  return std::make_unique<OnnxPolicy>(policy, evaluation_choice_seed(seed));
}

}  // namespace citylearn::python
