// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/learner_run.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

namespace citylearn {

std::string LearnerRun::actors_note() const {
  return fmt::format("  {} actors, lag {:.1f}", server_->actors(), report_.policy_lag);
}

void LearnerRun::evaluate_others() {
  context_.client.subscribe(/*observations=*/true, /*episodes=*/true);
  TrainingRun::evaluate_others();
  context_.client.subscribe(/*observations=*/false, /*episodes=*/true);
}

void LearnerRun::train() {
  LearnerServerOptions options;
  options.traversal = context_.options.train;
  options.traversal_hash = context_.env_on(context_.options.train)->info.hash();
  options.window = context_.options.window;
  options.max_lag = context_.options.max_lag;
  options.run_id = context_.records.run_id();
  server_ = std::make_unique<LearnerServer>(context_.node, *trainer_, options);
  context_.on_spin = [this] { server_->handle(); };
  context_.client.subscribe(/*observations=*/false, /*episodes=*/true);
  Clock::time_point next_log = Clock::now() + std::chrono::seconds(5);
  while (!trainer_->done()) {
    context_.spin();
    if (server_->ready()) {
      if (!update([this] { return server_->learn(); })) break;
      continue;
    }
    if (server_->actors() == 0) {
      context_.node.report(msg::WAITING, "waiting for actors");
      if (Clock::now() > next_log) spdlog::info("waiting for actors (policy_service --role actor)");
    }
    if (server_->actors() > 0 || Clock::now() > next_log) next_log = Clock::now() + std::chrono::seconds(10);
  }
  report_.wall = wall();
  await_release();
  report_.dropped = server_->dropped();
  report_.waited = server_->waited();
  spdlog::info("mean policy lag {:.2f} updates, {} trajectories were too old, actors waited {:.1f} s for room",
               report_.policy_lag, report_.dropped, report_.waited);
}

/// Takes the env_services over from the actors.
void LearnerRun::await_release() {
  server_->end();
  const Clock::time_point deadline = Clock::now() + std::chrono::seconds(5);
  while (!server_->released() && Clock::now() < deadline) context_.spin();
  context_.client.subscribe(/*observations=*/true, /*episodes=*/true);
  // The env_services obey the service that started last, which may be an actor.
  for (const auto& [id, env] : context_.client.envs()) context_.client.acquire_lease(*env);
}

}  // namespace citylearn
