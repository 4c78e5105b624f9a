// SPDX-License-Identifier: Apache-2.0
// The learner `ppo` once more, in torch: a plug-in (docs/how-to/load-a-plugin.md), so that nothing else waits for
// libtorch to be loaded.
#include <dlfcn.h>
#include <torch/cuda.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "core/wire/messages.h"
#include "policy_service/learning/learner.h"
#include "policy_service/learning/optimization/advantages.h"
#include "policy_service/learning/optimization/random_streams.h"
#include "policy_service/learning/optimization/saved_state.h"
#include "policy_service/learning/optimization/sequences.h"

namespace citylearn {
namespace {

const std::string kWho = "learner torch_ppo";

/// Runs `work`; what torch says of a failure becomes one line.
template <class Work>
auto in_torch(const Work& work) {
  try {
    return work();
  } catch (const c10::Error& error) {
    throw Error(error.what_without_backtrace(), kWho);
  }
}

// OpenBLAS takes all cores unless told, whatever torch's own threads are.
void set_threads(int threads) {
  at::set_num_threads(threads);
  if (void* found = dlsym(RTLD_DEFAULT, "openblas_set_num_threads")) reinterpret_cast<void (*)(int)>(found)(threads);
}

/// Whole sequences side by side. Row t * B + b is sequence b at its step t: the transpose of this project's matrices,
/// which lie column by column, so that the memory is the same.
struct Batch {
  torch::Tensor sensed;     // TB x sensors
  torch::Tensor actions;    // TB x 3 or 6: the previous one, then those not allowed
  torch::Tensor h, c;       // B x cells, before the first step
  torch::Tensor keep;       // T x B x 1: 0 = an episode begins, and the state is wiped
  torch::Tensor masked;     // TB x 3: what is added to logits
  torch::Tensor chosen;     // TB x 3: one-hot
  torch::Tensor samples;    // TB x 4: log-probability, advantage, value, target
  torch::Tensor auxiliary;  // TB x 2: the truth
  std::vector<bool> wiped;  // T: some state is wiped there
  std::array<torch::Tensor*, 9> all() {
    return {&sensed, &actions, &h, &c, &keep, &masked, &chosen, &samples, &auxiliary};
  }
};

/// networks/lstm.h with torch's derivatives: sensors -> linear -> with the previous action -> LSTM -> heads.
class LstmInTorch {
 public:
  LstmInTorch(const LearnerTask& task, torch::Device device)
      : baseline_(task.agent == "baseline"), frames_(static_cast<float>(task.task.frames)) {
    if (task.agent != "features" && task.agent != "baseline")
      throw Error("learns the networks features and baseline, not " + task.agent, kWho, "take --learner ppo");
    sensors_ = baseline_ ? 2 : task.task.features + 1;
    cells_ = task.parameters.integer("cells");
    rectified_ = task.parameters.flag("relu");
    extra_ = task.parameters.flag("mask-input") ? 2 * kActions : kActions;
    scale_ = static_cast<float>(task.parameters["scale"]);
    goal_scale_ = baseline_ ? scale_ : static_cast<float>(task.parameters["goal-scale"]);

    const int hidden = task.parameters.integer("hidden");
    flat = torch::zeros({task.network.parameter_count()}, device);
    gradient = torch::zeros_like(flat);
    const auto tensor = [&](const std::string& name, int rows, int cols) {
      return leaf(task.network, name, rows, cols);
    };
    sensors_weight_ = tensor("sensors.weight", hidden, sensors_);
    sensors_bias_ = tensor("sensors.bias", hidden, 1);
    lstm_input_ = tensor("lstm.input", 4 * cells_, hidden + extra_);
    lstm_recurrent_ = tensor("lstm.recurrent", 4 * cells_, cells_);
    lstm_bias_ = tensor("lstm.bias", 4 * cells_, 1);
    heads_weight_ = tensor("heads.weight", kActions + 1, cells_);
    heads_bias_ = tensor("heads.bias", kActions + 1, 1);
    auxiliary_weight_ = tensor("auxiliary.weight", 2, cells_);
    auxiliary_bias_ = tensor("auxiliary.bias", 2, 1);
  }

  int sensors() const { return sensors_; }
  int cells() const { return cells_; }
  int extra() const { return extra_; }

  /// Writes the network's inputs of column `from`. `sensed` has room for sensors() numbers, `actions` for extra().
  void sense(const NetworkInputs<float>& inputs, std::size_t from, float* sensed, float* actions) const {
    const float goal = static_cast<float>(inputs.goal[from]) / frames_ - 0.5f;
    if (baseline_)
      sensed[0] = scale_ * (static_cast<float>(inputs.position[from]) / frames_ - 0.5f);
    else
      Eigen::Map<Vector<float>>(sensed, sensors_ - 1) = scale_ * inputs.features_of(static_cast<std::ptrdiff_t>(from));
    sensed[sensors_ - 1] = goal_scale_ * goal;
    std::fill(actions, actions + extra_, 0.0f);
    if (inputs.previous_action[from] < kActions) actions[inputs.previous_action[from]] = 1;
    for (int action = 0; extra_ > kActions && action < kActions; ++action)
      actions[kActions + action] = inputs.allowed[from] >> action & 1 ? 0 : 1;
  }

  struct Heads {
    torch::Tensor logits, values, auxiliary;  // TB x 3, TB, TB x 2 (undefined unless asked for)
  };
  Heads forward(const Batch& batch, bool localise) const {
    auto embedded = torch::addmm(sensors_bias_, batch.sensed, sensors_weight_);
    embedded = rectified_ ? embedded.relu() : embedded.tanh();
    const std::int64_t steps = batch.keep.size(0), agents = batch.keep.size(1);
    const auto entering = torch::addmm(lstm_bias_, torch::cat({embedded, batch.actions}, 1), lstm_input_)
                              .view({steps, agents, 4 * cells_})
                              .unbind(0);
    torch::Tensor h = batch.h, c = batch.c;
    std::vector<torch::Tensor> all;
    for (std::size_t t = 0; t < entering.size(); ++t) {
      if (batch.wiped[t]) {
        const auto keep = batch.keep[static_cast<std::int64_t>(t)];
        h = h * keep;
        c = c * keep;
      }
      const auto parts = torch::addmm(entering[t], h, lstm_recurrent_).split_with_sizes({3 * cells_, cells_}, 1);
      const auto gates = parts[0].sigmoid().chunk(3, 1);  // input, forget, output
      c = torch::addcmul(gates[1] * c, gates[0], parts[1].tanh());
      h = gates[2] * c.tanh();
      all.push_back(h);
    }
    const auto seen = torch::cat(all, 0);
    const auto both = torch::addmm(heads_bias_, seen, heads_weight_).split_with_sizes({kActions, 1}, 1);
    return {both[0] + batch.masked, both[1].squeeze(1),
            localise ? torch::addmm(auxiliary_bias_, seen, auxiliary_weight_) : torch::Tensor()};
  }

  torch::Tensor flat, gradient;  ///< all parameters in the network's order, and the loss's derivatives by them

 private:
  /// A parameter within `flat`, its gradient within `gradient`. Column-major rows x cols is torch's cols x rows.
  torch::Tensor leaf(const AgentNetwork<float>& network, const std::string& name, int rows, int cols) const {
    for (const Tensor& tensor : network.tensors()) {
      if (tensor.name != name) continue;
      if (tensor.rows != rows || tensor.cols != cols) break;
      const auto part = [&](const torch::Tensor& all) {
        return all.narrow(0, tensor.offset, tensor.rows * tensor.cols).view({tensor.cols, tensor.rows}).detach();
      };
      torch::Tensor result = part(flat).set_requires_grad(true);
      result.mutable_grad() = part(gradient);
      return result;
    }
    throw Error("the network has no tensor " + name + " of " + std::to_string(rows) + " x " + std::to_string(cols),
                kWho);
  }

  bool baseline_, rectified_;
  float frames_, scale_, goal_scale_;
  int sensors_, cells_, extra_;
  torch::Tensor sensors_weight_, sensors_bias_, lstm_input_, lstm_recurrent_, lstm_bias_, heads_weight_, heads_bias_,
      auxiliary_weight_, auxiliary_bias_;
};

/// Recurrent PPO as learners/ppo.cc has it, draw for draw: from the same rollouts both do the same but for rounding.
class TorchPpo : public Learner {
 public:
  TorchPpo(const Parameters& parameters, const LearnerTask& task)
      : frames_(task.task.frames),
        seed_(task.seed),
        total_steps_(static_cast<double>(task.total_steps)),
        parameter_(parameters),
        epochs_(parameters.integer("epochs")),
        minibatch_(parameters.integer("minibatch")),
        threads_(parameters.integer("threads")),
        localise_(parameters["localisation"] > 0 || parameters["orientation"] > 0),
        device_(prepare_torch(parameters)),
        network_(task, device_) {
    Random random{seed_, kInitialise};
    task.network.initialise(random, parameters_);
    first_moment_ = torch::zeros_like(network_.flat);
    second_moment_ = torch::zeros_like(network_.flat);
    give(parameters_, network_.flat);
  }

  static std::vector<ParameterSpec> parameter_specs() {
    std::vector<ParameterSpec> specs = LearnerRegistry::instance().find("learner", "ppo").parameters;
    std::erase_if(specs, [](const ParameterSpec& spec) { return spec.name == "shards"; });  // torch divides by itself
    specs.insert(specs.end(), {{"threads", "of torch; at every product they wait for one another: for quiet machines",
                                1, 1, 256, true},
                               {"gpu", "1: on the GPU where libtorch finds one", 1, 0, 1, true}});
    return specs;
  }

  void set_progress(double fraction) override { elapsed_ = std::min(1.0, fraction); }
  UpdateFigures update(std::span<Rollout* const> rollouts) override {
    return in_torch([&] { return learn(rollouts); });
  }

  const Vector<float>& parameters() const override { return parameters_; }

  void save(LearnerState& state) const override {
    state.counters = {{"updates", updates_}, {"steps", steps_}, {"adam_steps", adam_steps_}};
    state.tensors = {{"parameters", parameters_}};
    take(first_moment_, state.tensors["adam.first"]);
    take(second_moment_, state.tensors["adam.second"]);
  }

  void load(const LearnerState& state) override {
    require_state(state, kWho, {"updates", "steps", "adam_steps"}, {"parameters", "adam.first", "adam.second"},
                  parameters_.size());
    updates_ = state.counters.at("updates");
    steps_ = state.counters.at("steps");
    adam_steps_ = state.counters.at("adam_steps");
    parameters_ = state.tensors.at("parameters");
    give(parameters_, network_.flat);
    give(state.tensors.at("adam.first"), first_moment_);
    give(state.tensors.at("adam.second"), second_moment_);
  }

 private:
  static torch::Device prepare_torch(const Parameters& parameters) {
    set_threads(parameters.integer("threads"));
    setenv("CUBLAS_WORKSPACE_CONFIG", ":4096:8", 0);  // cuBLAS repeats itself only with this
    at::globalContext().setDeterministicAlgorithms(true, false);
    return parameters.flag("gpu") && torch::cuda::is_available() ? torch::Device(torch::kCUDA)
                                                                 : torch::Device(torch::kCPU);
  }

  static void give(const Vector<float>& from, torch::Tensor& to) {
    const torch::NoGradGuard guard;
    to.copy_(torch::from_blob(const_cast<float*>(from.data()), {from.size()}));
  }
  static void take(const torch::Tensor& from, Vector<float>& to) {
    to.resize(from.size(0));
    torch::from_blob(to.data(), {to.size()}).copy_(from);
  }

  UpdateFigures learn(std::span<Rollout* const> rollouts) {
    if (at::get_num_threads() != threads_) set_threads(threads_);  // torch counts them by thread
    list_sequences(rollouts, sequences_);
    estimate_advantages(rollouts, parameter_["gamma"], parameter_["lambda"], parameter_.flag("normalise-advantages"));
    const double progress =
        std::max(elapsed_, total_steps_ > 0 ? std::min(1.0, static_cast<double>(steps_) / total_steps_) : 0);
    UpdateFigures figures;
    figures.learning_rate = parameter_["learning-rate"] * (1 - (1 - parameter_["learning-rate-end"]) * progress);
    const double until = parameter_["entropy-until"];
    const double entropy = parameter_["entropy"] * (until > 0 ? std::max(0.0, 1 - progress / until) : 1);

    torch::Tensor sums = torch::zeros({kFigures}, device_);
    double samples = 0;
    const std::size_t batches = std::max<std::size_t>(1, sequences_.size() / static_cast<std::size_t>(minibatch_));
    Random random{seed_, kShuffle, updates_};
    for (int epoch = 0; epoch < epochs_; ++epoch) {
      shuffle(random, sequences_);
      for (std::size_t batch = 0; batch < batches; ++batch) {
        const std::span<const Sequence> chosen = part_of(sequences_, batch, batches);
        const Batch gathered = gather(rollouts, chosen);
        network_.gradient.zero_();
        const auto heads = network_.forward(gathered, localise_);
        loss(heads, gathered, entropy, sums).backward();
        figures.gradient_norm += step(figures.learning_rate) / static_cast<double>(batches) / epochs_;
        samples += static_cast<double>(chosen.size()) * rollouts[0]->sequence;
      }
    }
    for (const Rollout* rollout : rollouts) steps_ += rollout->action.size();
    ++updates_;
    take(network_.flat, parameters_);
    const torch::Tensor means = (sums / samples).to(torch::kCPU, torch::kDouble);
    std::size_t i = 0;
    for (double* figure : {&figures.policy_loss, &figures.value_loss, &figures.entropy, &figures.approx_kl,
                           &figures.clip_fraction, &figures.localisation_loss, &figures.orientation_loss})
      *figure = means.data_ptr<double>()[i++];
    return figures;
  }

  Batch gather(std::span<Rollout* const> rollouts, std::span<const Sequence> sequences) const {
    const std::int64_t steps = rollouts[0]->sequence, agents = static_cast<std::int64_t>(sequences.size());
    const std::int64_t rows = steps * agents, cells = network_.cells();
    Batch batch;
    batch.sensed = torch::empty({rows, network_.sensors()});
    batch.actions = torch::empty({rows, network_.extra()});
    batch.h = torch::empty({agents, cells});
    batch.c = torch::empty({agents, cells});
    batch.keep = torch::empty({steps, agents, 1});
    batch.masked = torch::zeros({rows, kActions});
    batch.chosen = torch::zeros({rows, kActions});
    batch.samples = torch::empty({rows, 4});
    batch.auxiliary = torch::empty({rows, 2});
    batch.wiped.assign(static_cast<std::size_t>(steps), false);
    for (std::int64_t b = 0; b < agents; ++b) {
      const Track track(rollouts, sequences[static_cast<std::size_t>(b)]);
      const Rollout& rollout = track.rollout();
      const float* state = track.state().data();  // h, then c
      std::copy(state, state + cells, batch.h.data_ptr<float>() + b * cells);
      std::copy(state + cells, state + 2 * cells, batch.c.data_ptr<float>() + b * cells);
      for (std::int64_t t = 0; t < steps; ++t) {
        const auto from = static_cast<std::size_t>(track.column(t));
        const std::int64_t row = t * agents + b;
        const NetworkInputs<float>& inputs = rollout.inputs;
        network_.sense(inputs, from, batch.sensed.data_ptr<float>() + row * network_.sensors(),
                       batch.actions.data_ptr<float>() + row * network_.extra());
        batch.keep.data_ptr<float>()[row] = inputs.first[from] ? 0 : 1;
        if (inputs.first[from]) batch.wiped[static_cast<std::size_t>(t)] = true;
        for (int action = 0; action < kActions; ++action)
          if (!(inputs.allowed[from] >> action & 1)) batch.masked.data_ptr<float>()[row * kActions + action] = kMasked;
        batch.chosen.data_ptr<float>()[row * kActions + rollout.action[from]] = 1;
        const std::array samples = {rollout.log_probability[from], rollout.advantage[from], rollout.value[from],
                                    rollout.target[from]};
        std::copy(samples.begin(), samples.end(), batch.samples.data_ptr<float>() + row * 4);
        const auto truth = auxiliary_targets<float>(inputs.position[from], inputs.goal[from], frames_);
        std::copy(truth.begin(), truth.end(), batch.auxiliary.data_ptr<float>() + row * 2);
      }
    }
    for (torch::Tensor* tensor : batch.all()) *tensor = tensor->to(device_);
    return batch;
  }

  /// Returns the mean over the samples of what learners/ppo_loss.h computes; `sums` gets the figures' sums.
  torch::Tensor loss(const LstmInTorch::Heads& heads, const Batch& batch, double entropy_weight,
                     torch::Tensor& sums) const {
    const auto samples = batch.samples.unbind(1);
    const torch::Tensor &old_log_p = samples[0], &advantage = samples[1], &old_value = samples[2], &target = samples[3];
    const auto log_p = heads.logits.log_softmax(1);
    const auto entropy = -(log_p.exp() * log_p).sum(1);

    // Beyond e^30 a ratio only has to stay finite, and its derivatives too.
    const auto log_ratio = ((log_p * batch.chosen).sum(1) - old_log_p).clamp(-30, 30);
    const auto ratio = log_ratio.exp();
    const double clip = parameter_["clip"];
    const auto free = ratio * advantage, held = (ratio.clamp(1 - clip, 1 + clip) * advantage).detach();
    const auto policy = -torch::where(held < free.detach(), held, free);

    auto error = heads.values - target;
    if (const double reach = parameter_["value-clip"]; reach > 0) {
      const auto change = heads.values.detach() - old_value;
      const auto limited = old_value + change.clamp(-reach, reach) - target;
      error = torch::where((change.abs() > reach) & (limited.abs() > error.detach().abs()), limited, error);
    }
    const auto value = 0.5 * error.square();

    auto total = policy.mean() + parameter_["value-weight"] * value.mean() - entropy_weight * entropy.mean();
    torch::Tensor place = torch::zeros({1}, device_), way = place;
    if (localise_) {
      const auto squares = (heads.auxiliary - batch.auxiliary).square();
      place = squares.select(1, 0);
      way = squares.select(1, 1);
      total = total + parameter_["localisation"] * place.mean() + parameter_["orientation"] * way.mean();
    }
    const torch::NoGradGuard guard;
    sums += torch::stack({policy.sum(), value.sum(), entropy.sum(), (ratio - 1 - log_ratio).sum(),
                          ((ratio - 1).abs() > clip).sum().to(torch::kFloat), place.sum(), way.sum()});
    return total;
  }

  /// One step of Adam. Returns the gradient's length before clipping.
  double step(double learning_rate) {
    const torch::NoGradGuard guard;
    const double norm = network_.gradient.norm().item<double>();
    network_.gradient.mul_(std::min(1.0, parameter_["gradient-norm"] / (norm + 1e-12)));
    ++adam_steps_;
    const double correction1 = 1 - std::pow(kBeta1, static_cast<double>(adam_steps_));
    const double correction2 = 1 - std::pow(kBeta2, static_cast<double>(adam_steps_));
    first_moment_.mul_(kBeta1).add_(network_.gradient, 1 - kBeta1);
    second_moment_.mul_(kBeta2).addcmul_(network_.gradient, network_.gradient, 1 - kBeta2);
    const auto below = second_moment_.sqrt().div_(std::sqrt(correction2)).add_(parameter_["adam-epsilon"]);
    network_.flat.addcdiv_(first_moment_, below, -learning_rate / correction1);
    return norm;
  }

  static constexpr double kBeta1 = 0.9, kBeta2 = 0.999;
  static constexpr float kMasked = -1e9f;  // as networks/parts.h
  static constexpr std::int64_t kFigures = 7;

  const int frames_;
  const std::uint64_t seed_;
  const double total_steps_;
  const Parameters parameter_;
  const int epochs_, minibatch_, threads_;
  const bool localise_;
  const torch::Device device_;
  LstmInTorch network_;

  Vector<float> parameters_;
  torch::Tensor first_moment_, second_moment_;
  std::uint64_t updates_ = 0, steps_ = 0, adam_steps_ = 0;
  double elapsed_ = 0;  // fraction of the run that has passed by the clock
  std::vector<Sequence> sequences_;
};

const LearnerRegistry::Registration torch_ppo_registration{
    {"torch_ppo", "ppo in libtorch, for the networks features and baseline", TorchPpo::parameter_specs(),
     [](const Parameters& parameters, const LearnerTask& task) -> std::unique_ptr<Learner> {
       return in_torch([&] { return std::make_unique<TorchPpo>(parameters, task); });
     }}};

}  // namespace
}  // namespace citylearn
