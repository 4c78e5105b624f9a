#include <array>
#include <cmath>
#include <memory>
#include <numeric>

#include "policy_service/learner.h"
#include "policy_service/learners/ppo_loss.h"
#include "policy_service/worker.h"

namespace citylearn {
namespace {

enum Purpose : std::uint64_t { kInitialise = 1, kShuffle = 2 };  // of a random stream

/// Proximal policy optimisation (Schulman et al., 2017) for recurrent networks: minibatches of whole sequences,
/// gradients through each from the recurrent state it was collected with. Each minibatch is halved by sequence, one
/// half a thread, and the two gradients are added in this order: results don't depend on timing.
class Ppo : public Learner {
 public:
  Ppo(const Parameters& parameters, const LearnerTask& task)
      : network_(task.network),
        frames_(task.task.frames),
        seed_(task.seed),
        total_steps_(static_cast<double>(task.total_steps)),
        learning_rate_(parameters["learning-rate"]),
        learning_rate_end_(parameters["learning-rate-end"]),
        epochs_(parameters.integer("epochs")),
        minibatch_(parameters.integer("minibatch")),
        gamma_(parameters["gamma"]),
        lambda_(parameters["lambda"]),
        entropy_(parameters["entropy"]),
        entropy_until_(parameters["entropy-until"]),
        gradient_norm_(parameters["gradient-norm"]),
        adam_epsilon_(parameters["adam-epsilon"]),
        normalise_(parameters.flag("normalise-advantages")) {
    weights_.clip = parameters["clip"];
    weights_.value_clip = parameters["value-clip"];
    weights_.value = parameters["value-weight"];
    weights_.localisation = parameters["localisation"];
    weights_.orientation = parameters["orientation"];
    Random random{seed_, kInitialise};
    network_.initialise(random, parameters_);
    first_moment_.setZero(parameters_.size());
    second_moment_.setZero(parameters_.size());
    for (Half& half : halves_) {
      half.workspace = network_.make_workspace();
      half.workspace->localise = weights_.localisation > 0 || weights_.orientation > 0;
      half.gradient.resize(parameters_.size());
    }
  }

  static std::vector<ParameterSpec> parameter_specs() {
    return {
        {"learning-rate", "of Adam, at the start; falls linearly", 1e-3, 1e-8, 1},
        {"learning-rate-end", "learning rate at the end, as a share of that at the start", 0, 0, 1},
        {"epochs", "times an update goes through its samples", 3, 1, 100, true},
        {"minibatch", "sequences in a minibatch", 4, 1, 65536, true},
        {"gamma", "discount a step", 0.99, 0, 1},
        {"lambda", "of generalised advantage estimation", 0.95, 0, 1},
        {"clip", "of the ratio of probabilities", 0.2, 0.01, 10},
        {"value-clip", "of a value's change; 0 = not clipped", 0.2, 0, 1000},
        {"value-weight", "of the value loss", 0.5, 0, 1000},
        {"entropy", "weight of the entropy bonus at the start", 0.02, 0, 10},
        {"entropy-until", "share of the run after which it has fallen to 0, linearly; 0 = it does not fall", 0, 0, 1},
        {"localisation", "weight of telling one's place, a loss of training alone; 0 = none", 0, 0, 1000},
        {"orientation", "weight of telling the way to the goal, likewise", 0, 0, 1000},
        {"gradient-norm", "the gradient is scaled down to this length", 0.5, 1e-6, 1e6},
        {"adam-epsilon", "of Adam", 1e-5, 1e-12, 1},
        {"normalise-advantages", "1: an update's advantages get mean 0 and deviation 1", 1, 0, 1, true}};
  }

  UpdateFigures update(std::span<Rollout* const> rollouts) override {
    prepare(rollouts);
    const double progress = total_steps_ > 0 ? std::min(1.0, static_cast<double>(steps_) / total_steps_) : 0;
    const double learning_rate = learning_rate_ * (1 - (1 - learning_rate_end_) * progress);
    weights_.entropy = entropy_until_ > 0 ? entropy_ * std::max(0.0, 1 - progress / entropy_until_) : entropy_;

    UpdateFigures figures;
    PpoSums sums;
    double samples = 0, norms = 0;
    const std::size_t count = sequences_.size();
    const std::size_t batches = std::max<std::size_t>(1, count / static_cast<std::size_t>(minibatch_));
    Random random{seed_, kShuffle, updates_};
    for (int epoch = 0; epoch < epochs_; ++epoch) {
      for (std::size_t i = count - 1; i > 0; --i) std::swap(sequences_[i], sequences_[random.below(i + 1)]);
      for (std::size_t batch = 0; batch < batches; ++batch) {
        const std::size_t begin = batch * count / batches, end = (batch + 1) * count / batches;
        const std::span<const Sequence> chosen(sequences_.data() + begin, end - begin);
        norms += learn(rollouts, chosen, learning_rate);
        for (const Half& half : halves_) sums += half.sums;
        samples += static_cast<double>(chosen.size()) * rollouts[0]->sequence;
      }
    }
    for (const Rollout* rollout : rollouts) steps_ += rollout->action.size();
    ++updates_;
    figures.policy_loss = sums.policy / samples;
    figures.value_loss = sums.value / samples;
    figures.entropy = sums.entropy / samples;
    figures.divergence = sums.divergence / samples;
    figures.clipped = sums.clipped / samples;
    figures.localisation_loss = sums.localisation / samples;
    figures.orientation_loss = sums.orientation / samples;
    figures.gradient_norm = norms / static_cast<double>(batches) / epochs_;
    figures.learning_rate = learning_rate;
    return figures;
  }

  const Vector<float>& parameters() const override { return parameters_; }

  void save(LearnerState& state) const override {
    state.counters = {{"updates", updates_}, {"steps", steps_}, {"adam_steps", adam_steps_}};
    state.tensors = {{"parameters", parameters_}, {"adam.first", first_moment_}, {"adam.second", second_moment_}};
  }

  void load(const LearnerState& state) override {
    for (const char* name : {"updates", "steps", "adam_steps"})
      if (!state.counters.contains(name)) throw Error("has no counter '" + std::string(name) + "'", "learner ppo");
    for (const char* name : {"parameters", "adam.first", "adam.second"}) {
      const auto found = state.tensors.find(name);
      if (found == state.tensors.end()) throw Error("has no tensor '" + std::string(name) + "'", "learner ppo");
      if (found->second.size() != parameters_.size())
        throw Error("tensor '" + std::string(name) + "' has " + std::to_string(found->second.size()) +
                        " numbers, not " + std::to_string(parameters_.size()),
                    "learner ppo");
    }
    updates_ = state.counters.at("updates");
    steps_ = state.counters.at("steps");
    adam_steps_ = state.counters.at("adam_steps");
    parameters_ = state.tensors.at("parameters");
    first_moment_ = state.tensors.at("adam.first");
    second_moment_ = state.tensors.at("adam.second");
  }

 private:
  struct Sequence {
    std::uint32_t rollout, index;  // as Rollout numbers them
  };
  struct Half {
    std::unique_ptr<Workspace<float>> workspace;
    NetworkInputs<float> inputs;
    Matrix<float> state;
    PpoSamples<float> samples;
    Heads<float> derivative;
    Vector<float> gradient;
    PpoSums sums;
    double squares = 0;
  };

  /// Advantages, their normalisation, and the list of sequences.
  void prepare(std::span<Rollout* const> rollouts) {
    sequences_.clear();
    double sum = 0, squares = 0, count = 0;
    for (std::size_t r = 0; r < rollouts.size(); ++r) {
      Rollout& rollout = *rollouts[r];
      rollout.estimate_advantages(gamma_, lambda_);
      for (int i = 0; i < rollout.sequences(); ++i)
        sequences_.push_back({static_cast<std::uint32_t>(r), static_cast<std::uint32_t>(i)});
      for (float advantage : rollout.advantage) {
        sum += advantage;
        squares += static_cast<double>(advantage) * advantage;
      }
      count += static_cast<double>(rollout.advantage.size());
    }
    if (!normalise_) return;
    const double mean = sum / count, deviation = std::sqrt(std::max(0.0, squares / count - mean * mean));
    for (Rollout* rollout : rollouts)
      for (float& advantage : rollout->advantage)
        advantage = static_cast<float>((advantage - mean) / (deviation + 1e-8));
  }

  /// One step of Adam on a minibatch. Returns the gradient's length before clipping.
  double learn(std::span<Rollout* const> rollouts, std::span<const Sequence> chosen, double learning_rate) {
    const float share = 1.0f / static_cast<float>(chosen.size() * static_cast<std::size_t>(rollouts[0]->sequence));
    const std::size_t middle = (chosen.size() + 1) / 2;
    worker_.both([&](int which) {
      differentiate(rollouts, which == 0 ? chosen.first(middle) : chosen.subspan(middle), share, halves_[which]);
    });
    // From here on each thread has half of the parameters.
    const std::ptrdiff_t half_size = parameters_.size() / 2;
    const auto range = [&](int which, Vector<float>& all) {
      return which == 0 ? all.head(half_size) : all.tail(all.size() - half_size);
    };
    worker_.both([&](int which) {
      auto gradient = range(which, halves_[0].gradient);
      gradient += range(which, halves_[1].gradient);
      halves_[which].squares = static_cast<double>(gradient.squaredNorm());
    });
    const double norm = std::sqrt(halves_[0].squares + halves_[1].squares);
    ++adam_steps_;
    const double correction1 = 1 - std::pow(kBeta1, static_cast<double>(adam_steps_));
    const double correction2 = 1 - std::pow(kBeta2, static_cast<double>(adam_steps_));
    const float scale = static_cast<float>(std::min(1.0, gradient_norm_ / (norm + 1e-12)));
    const float rate = static_cast<float>(learning_rate / correction1);
    const float spread = static_cast<float>(1 / std::sqrt(correction2)), epsilon = static_cast<float>(adam_epsilon_);
    worker_.both([&](int which) {
      const auto gradient = range(which, halves_[0].gradient).array() * scale;
      auto first = range(which, first_moment_).array(), second = range(which, second_moment_).array();
      first = static_cast<float>(kBeta1) * first + static_cast<float>(1 - kBeta1) * gradient;
      second = static_cast<float>(kBeta2) * second + static_cast<float>(1 - kBeta2) * gradient.square();
      range(which, parameters_).array() -= rate * first / (second.sqrt() * spread + epsilon);
    });
    return norm;
  }

  void differentiate(std::span<Rollout* const> rollouts, std::span<const Sequence> chosen, float share,
                     Half& half) const {
    half.gradient.setZero();
    half.sums = {};
    if (chosen.empty()) return;
    gather(rollouts, chosen, half);
    network_.forward(parameters_, half.inputs, half.state, *half.workspace);
    half.sums = ppo_loss(weights_, half.samples, half.inputs, frames_, half.workspace->heads, share, half.derivative);
    network_.backward(parameters_, half.inputs, *half.workspace, half.derivative, half.gradient);
  }

  void gather(std::span<Rollout* const> rollouts, std::span<const Sequence> chosen, Half& half) const {
    const Rollout& model = *rollouts[0];
    const int length = model.sequence, batch = static_cast<int>(chosen.size());
    half.inputs.resize(static_cast<int>(model.inputs.features.rows()), length, batch);
    half.inputs.frames = model.inputs.frames;
    half.state.resize(model.states.rows(), batch);
    half.samples.resize(static_cast<std::size_t>(length) * chosen.size());
    for (int b = 0; b < batch; ++b) {
      const Rollout& rollout = *rollouts[chosen[b].rollout];
      const std::ptrdiff_t agents = rollout.inputs.agents, index = chosen[b].index;
      const std::ptrdiff_t agent = index % agents, begin = index / agents * length;
      half.state.col(b) = rollout.states.col(index);
      for (std::ptrdiff_t t = 0; t < length; ++t) {
        const std::ptrdiff_t from = (begin + t) * agents + agent, to = t * batch + b;
        half.inputs.copy_column(rollout.inputs, from, to);
        const auto f = static_cast<std::size_t>(from), k = static_cast<std::size_t>(to);
        half.samples.action[k] = rollout.action[f];
        half.samples.log_probability[k] = rollout.log_probability[f];
        half.samples.advantage[k] = rollout.advantage[f];
        half.samples.value[k] = rollout.value[f];
        half.samples.target[k] = rollout.target[f];
      }
    }
  }

  static constexpr double kBeta1 = 0.9, kBeta2 = 0.999;

  const AgentNetwork<float>& network_;
  const int frames_;
  const std::uint64_t seed_;
  const double total_steps_, learning_rate_, learning_rate_end_;
  const int epochs_, minibatch_;
  const double gamma_, lambda_, entropy_, entropy_until_, gradient_norm_, adam_epsilon_;
  const bool normalise_;
  PpoWeights weights_;

  Vector<float> parameters_, first_moment_, second_moment_;
  std::uint64_t updates_ = 0, steps_ = 0, adam_steps_ = 0;
  std::vector<Sequence> sequences_;
  mutable std::array<Half, 2> halves_;
  Worker worker_;
};

const LearnerRegistry::Registration registration{
    {"ppo", "recurrent proximal policy optimisation with Adam", Ppo::parameter_specs(),
     [](const Parameters& parameters, const LearnerTask& task) -> std::unique_ptr<Learner> {
       return std::make_unique<Ppo>(parameters, task);
     }}};

}  // namespace
}  // namespace citylearn
