// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstdio>
#include <ctime>
#include <vector>

#include "bench/cases/cases.h"
#include "core/task/action.h"
#include "core/util/random.h"
#include "policy_service/network/agent_network.h"
#include "tests/support/networks/small_networks.h"

namespace citylearn::bench {
namespace {

constexpr int kDimension = 64;

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
    task.reference = route_features(kDimension, places, random);
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

}  // namespace

Measure beliefs(CLI::App&) { return compare_beliefs; }

}  // namespace citylearn::bench
