// SPDX-License-Identifier: Apache-2.0
#include <malloc.h>

#include <array>
#include <ctime>
#include <map>

#include "bench/cases/cases.h"
#include "bench/made_up.h"
#include "core/util/random.h"
#include "policy_service/network/product.h"

namespace citylearn::bench {
namespace {

constexpr int kDimension = 64;

/// A network with random parameters and its passes over made-up inputs of so many steps of so many agents.
class Passes {
 public:
  Passes(const std::string& name, const NetworkTask& task, int steps, int agents) {
    const auto& entry = NetworkRegistry<float>::instance().find("network", name);
    network_ = entry.create(Parameters(name, entry.parameters, {}), task);
    Random random{1};
    network_->initialise(random, parameters_);
    gradient_.setZero(parameters_.size());
    make_up(inputs_, task, steps, agents, random);
    state_ = Matrix<float>::Zero(network_->state_size(), agents);
    derivative_.logits.setRandom(kActions, steps * agents);
    derivative_.values.setRandom(1, steps * agents);
    workspace_ = network_->make_workspace();
    workspace_->fixed = steps == 1 ? 1 : 0;  // as for acting
  }
  void forward() { network_->forward(parameters_, inputs_, state_, *workspace_); }
  void both() {
    forward();
    network_->backward(parameters_, inputs_, *workspace_, derivative_, gradient_);
  }

 private:
  std::unique_ptr<AgentNetwork<float>> network_;
  Vector<float> parameters_, gradient_;
  NetworkInputs<float> inputs_;
  Matrix<float> state_;
  Heads<float> derivative_;
  std::unique_ptr<Workspace<float>> workspace_;
};

/// Returns the seconds that `work` takes: the mean of what fits into half a second, after one to warm up.
template <class Work>
double seconds_each(const Work& work) {
  work();
  const Clock::time_point start = Clock::now();
  int times = 0;
  for (; seconds_since(start) < 0.5; ++times) work();
  return seconds_since(start) / times;
}

/// Floating point operations per second of a product m x k times k x n by each library, and of a network's forward and
/// backward pass by the chosen one (the paper's sizes).
void compare_products() {
  constexpr int kHidden = 512, kCells = 256;
  const auto rate = [](double operations, const auto& work) { return 1e-9 * operations / seconds_each(work); };
  NetworkTask task;
  task.features = kDimension;
  const std::string chosen(name_of(used_math()));
  std::printf("%-22s %9s %9s %9s %9s   one thread, GFLOP/s\n", "", "eigen", "onednn", "forward", "backward");
  for (const auto& [steps, agents] : {std::array{1, 8}, std::array{1, 16}, std::array{1, 32}, std::array{64, 4},
                                      std::array{64, 8}, std::array{64, 16}}) {
    const int columns = steps * agents;
    const Matrix<float> weights = Matrix<float>::Random(4 * kCells, kHidden),
                        right = Matrix<float>::Random(kHidden, columns);
    Matrix<float> out(4 * kCells, columns);
    std::map<std::string, double> plain;
    for (const std::string library : {"eigen", "onednn"}) {
      set_math(library);
      plain[library] = rate(2.0 * 4 * kCells * kHidden * columns, [&] { set_product(out, weights, right); });
    }
    set_math(chosen);
    Passes passes("features", task, steps, agents);
    const double operations =
        2.0 * columns * (kHidden * (kDimension + 1) + 4 * kCells * (kHidden + 6) + 4 * kCells * kCells + 4 * kCells);
    const double best = std::max(plain["eigen"], plain["onednn"]);
    const double forward = rate(operations, [&] { passes.forward(); });
    std::printf("steps %3d, agents %3d   %9.1f %9.1f %9.1f ", steps, agents, plain["eigen"], plain["onednn"], forward);
    if (steps == 1) {
      std::printf("%9s   %.0f %% of the faster product\n", "", 100 * forward / best);
      continue;
    }
    const double both = rate(operations, [&] { passes.both(); });
    const double backward = 2 / (1 / both - 1 / forward);  // twice the forward pass's operations
    std::printf("%9.1f   %.0f %%, %.0f %% of the faster product\n", backward, 100 * forward / best,
                100 * backward / best);
  }
}

/// 16 agents of place_filter that walk on along a route whose neighbouring places look alike, and see it with noise.
class Walk {
 public:
  static constexpr int kAgents = 16;

  Walk(NetworkTask task, int sparse_from) : task_(std::move(task)) {
    task_.sparse_from = sparse_from;
    const auto& entry = NetworkRegistry<float>::instance().find("network", "place_filter");
    network_ = entry.create(Parameters(entry.name, entry.parameters, {}), task_);
    network_->initialise(random_, parameters_);
    workspace_ = network_->make_workspace();
    workspace_->fixed = 1;
    state_ = Matrix<float>::Zero(network_->state_size(), kAgents);
    for (float& value : noise_.reshaped()) value = static_cast<float>(random_.normal() / 8);  // as long as features
  }
  /// All agents begin an episode, then take `steps` steps.
  void go(int steps) {
    for (int step = 0; step <= steps; ++step) {
      inputs_.resize(kDimension, 1, kAgents);
      inputs_.frames = task_.frames;
      for (int agent = 0; agent < kAgents; ++agent) {
        const auto i = static_cast<std::size_t>(agent);
        const auto place = (agent * task_.frames / kAgents + step + 1) % task_.frames;
        const auto seen = task_.reference.col(place) + noise_.col((17 * agent + step) % noise_.cols());
        inputs_.see(agent, -1, seen.normalized());
        inputs_.goal[i] = task_.frames / 2;
        inputs_.previous_action[i] = step == 0 ? static_cast<std::uint8_t>(kNoAction) : std::uint8_t{kNext};
        inputs_.allowed[i] = 7;
        inputs_.first[i] = step == 0;
      }
      network_->forward(parameters_, inputs_, state_, *workspace_);
      std::swap(state_, workspace_->state);
    }
  }

 private:
  NetworkTask task_;
  Random random_{1};
  std::unique_ptr<AgentNetwork<float>> network_;
  Vector<float> parameters_;
  NetworkInputs<float> inputs_;
  Matrix<float> state_, noise_{kDimension, 97};
  std::unique_ptr<Workspace<float>> workspace_;
};

/// Time of the processor that acting takes with whole and with sparse beliefs, by turns: episodes of 100 steps.
void compare_beliefs() {
  constexpr int kSteps = 100;
  Random random{2};
  for (const int places : {128, 512, 1024, 2048, 3576, 36000, 100000}) {
    NetworkTask task;
    task.features = kDimension;
    task.frames = places;
    task.reference.resize(kDimension, places);
    Vector<float> look = Vector<float>::Zero(kDimension);
    for (int place = 0; place < places; ++place) {
      for (float& value : look) value = 0.8f * value + 0.6f * static_cast<float>(random.normal());
      task.reference.col(place) = look.normalized();
    }
    Walk whole(task, places + 1), sparse(task, 0);
    std::array<std::vector<double>, 3> times;  // of the processor, whole and sparse; and their ratio
    for (int round = 0; round < 6; ++round) {
      for (const bool is_sparse : {false, true}) {
        const std::clock_t begin = std::clock();
        (is_sparse ? sparse : whole).go(kSteps);
        times[is_sparse].push_back(1e6 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
      }
      times[2].push_back(times[1].back() / times[0].back());
    }
    const double ratio = median(times[2]), steps = (kSteps + 1) * Walk::kAgents;
    std::printf("N = %6d: %7.2f us an agent-step with whole beliefs, %5.2f with sparse ones, ratio %.3f\n", places,
                median(times[0]) / steps, median(times[1]) / steps, ratio);
    record_figure({"sparse beliefs, " + std::to_string(places), ratio, "ratio", Better::kLower});
  }
}

/// Time and memory of place_filter as the route grows: both should follow N.
void compare_places() {
  constexpr int kSteps = 64, kAgents = 8;
  const auto used_memory = [] { return static_cast<double>(mallinfo2().uordblks + mallinfo2().hblkhd); };
  double first_time = 0, first_memory = 0;
  for (const int places : {128, 256, 512, 1024, 2048, 4096}) {
    NetworkTask task;
    task.features = kDimension;
    task.frames = places;
    task.reference = Matrix<float>::Random(kDimension, places).colwise().normalized();
    const double before = used_memory();
    Passes passes("place_filter", task, kSteps, kAgents);
    const double time = seconds_each([&] { passes.both(); }) / (kSteps * kAgents), memory = used_memory() - before;
    if (first_time == 0) first_time = time, first_memory = memory;
    const double growth = places / 128.0;
    std::printf(
        "N = %4d: %6.2f us a step forward and back, %6.2f MB; per place %.2f of the time and %.2f of the memory at N = "
        "128\n",
        places, 1e6 * time, 1e-6 * memory, time / first_time / growth, memory / first_memory / growth);
  }
}

}  // namespace

Measure places(CLI::App&) {
  return [] {
    compare_places();
    compare_beliefs();
  };
}

Measure products(CLI::App&) { return compare_products; }

}  // namespace citylearn::bench
