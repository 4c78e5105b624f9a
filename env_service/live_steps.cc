// SPDX-License-Identifier: Apache-2.0
#include "env_service/live_steps.h"

#include <utility>

namespace citylearn {

LiveSteps::LiveSteps(Environment& environment, std::unique_ptr<Robot> robot)
    : environment_(environment), robot_(std::move(robot)) {
  if (environment.agents() != 1) throw Error("a robot is one agent", "--agents", "give 1");
}

void LiveSteps::reset(const msg::TaskSettings& settings) {
  settings_ = settings;
  doing_ = Doing::kReset;
  robot_->look();
}

void LiveSteps::step(std::span<const std::uint8_t> actions) {
  environment_.check(actions);
  actions_.assign(actions.begin(), actions.end());
  doing_ = Doing::kStep;
  const std::uint8_t action = actions_.front();
  if (action == kNoAction) return;  // it waits, and sees what it saw
  const auto [from, to] = environment_.way(0, action);
  robot_->drive(action, from, to);
}

void LiveSteps::stop() {
  doing_ = Doing::kNothing;
  robot_->stop();
}

bool LiveSteps::advance(Clock::time_point now) {
  const auto seen = robot_->poll(now);
  const bool waits = doing_ == Doing::kStep && actions_.front() == kNoAction;
  if (doing_ == Doing::kNothing || (!seen && !waits)) return false;
  if (seen) environment_.sight(*seen);
  if (std::exchange(doing_, Doing::kNothing) == Doing::kReset)
    environment_.reset(settings_);
  else
    environment_.step(actions_);
  return true;
}

}  // namespace citylearn
