// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstdio>

#include "bench/cases/cases.h"
#include "core/util/random.h"
#include "policy_service/network/agent_network.h"

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

/// What acting costs with whole and with sparse beliefs: episodes of 100 steps.
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
    std::array<Contender, 2> turns{Contender{"whole", [&] { whole.go(kSteps); }},
                                   Contender{"sparse", [&] { sparse.go(kSteps); }}};
    take_turns(turns, 5);
    const auto each = [](const Contender& one) { return 1e6 * median(one.seconds) / (kSteps + 1) / Walk::kAgents; };
    std::printf("N = %6d: %7.2f us an agent-step with whole beliefs, %5.2f with sparse ones, ratio %.3f\n", places,
                each(turns[0]), each(turns[1]), median(turns[1].ratios));
    record_figure({"sparse beliefs, " + std::to_string(places), median(turns[1].ratios), "ratio", Better::kLower});
  }
}

}  // namespace

Measure beliefs(CLI::App&) { return compare_beliefs; }

}  // namespace citylearn::bench
