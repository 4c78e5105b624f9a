// SPDX-License-Identifier: Apache-2.0
#include "env_service/live_steps.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>

#include "core/task/action.h"

namespace citylearn {

LiveSteps::LiveSteps(Environment& environment, std::unique_ptr<Robot> robot)
    : environment_(environment), robot_(std::move(robot)) {
  if (environment.agents() != 1) throw Error("a robot is one agent", "--agents", "give 1");
  if (!robot_->has_goal_topic()) return;
  environment.use_external_goals();
  robot_->publish_status("stopped");
}

void LiveSteps::reset(const msg::TaskSettings& settings) {
  settings_ = settings;
  doing_ = Doing::kReset;
  driven_ = true;
  robot_->look();
}

void LiveSteps::step(std::span<const std::uint8_t> actions, const msg::Belief& belief) {
  environment_.check(actions);
  if (!std::exchange(driven_, true) && robot_->has_goal_topic()) publish_progress(true);
  actions_.assign(actions.begin(), actions.end());
  doing_ = environment_.awaits_goal() ? Doing::kAwaitGoal : Doing::kStep;
  if (doing_ == Doing::kAwaitGoal) return;
  std::uint8_t& action = actions_.front();
  if (action == kNoAction) return;  // it waits, and sees what it saw
  if (is_lost(belief)) action = kStay;
  const auto [from, to] = environment_.way(0, action);
  robot_->drive(action, from, to);
}

void LiveSteps::stop() {
  doing_ = Doing::kNothing;
  forget();
  robot_->stop();
  release();
}

void LiveSteps::release() {
  driven_ = false;
  if (!robot_->has_goal_topic()) return;
  if (std::exchange(goal_, std::nullopt)) robot_->refuse_goal("the policy_service no longer drives the robot");
  robot_->publish_status("stopped");
}

bool LiveSteps::advance(Clock::time_point now) {
  const auto seen = robot_->poll(now);
  take_goals();
  if (doing_ == Doing::kAwaitGoal && goal_) {
    doing_ = Doing::kStep;
    robot_->look();  // it may have been carried elsewhere
    return false;
  }
  const bool waits = doing_ == Doing::kStep && actions_.front() == kNoAction && !environment_.awaits_goal();
  if (!busy() || awaits_goal() || (!seen && !waits)) return false;
  if (seen) environment_.set_robot_pose(*seen);
  const bool begins = doing_ == Doing::kReset || environment_.awaits_goal();
  if (goal_ && seen && begins && nearest(seen->place) == *goal_) {
    robot_->publish_status("arrived " + std::to_string(*goal_));  // it stands there
    goal_.reset();
    if (doing_ == Doing::kStep) {
      doing_ = Doing::kAwaitGoal;
      return false;
    }
  }
  finish();
  return true;
}

/// Does in the environment what the robot has done.
void LiveSteps::finish() {
  bool began = environment_.awaits_goal();
  environment_.set_next_goal(goal_);
  if (std::exchange(doing_, Doing::kNothing) == Doing::kReset) {
    environment_.reset(settings_);
    began = true;
  } else {
    environment_.step(actions_);
  }
  if (!environment_.is_sent()) goal_.reset();
  environment_.set_next_goal(std::nullopt);
  if (began || !environment_.finished().empty()) forget();
  if (robot_->has_goal_topic()) publish_progress(began);
}

/// Returns whether the robot is lost, and says when that changes.
bool LiveSteps::is_lost(const msg::Belief& belief) {
  if (belief.lost().empty()) return false;
  const double bound = robot_->options().max_lost, lost = belief.lost().front();
  const std::uint32_t likeliest = belief.likely().front(), before = watch_.likeliest();
  const bool says_lost = watch_.says_lost(std::span(belief.likely()).first(msg::LIKELY_PLACES),
                                          std::span(belief.probability()).first(msg::LIKELY_PLACES), lost, bound);
  const bool stands = (says_lost || lost > bound) && bound < 1 && settings_.task_mode() == msg::EVALUATE;
  if (stands == !lost_.empty()) return stands;
  lost_ = !stands ? ""
          : lost > bound
              ? fmt::format(
                    "it is lost and stands: with probability {:.2f} it is not near place {}, where it is "
                    "likeliest (--max-lost {})",
                    lost, likeliest, bound)
              : fmt::format(
                    "it was lost and stands: it took itself to be near place {} and is likeliest near {} (--max-lost "
                    "{})",
                    before, likeliest, bound);
  if (robot_->has_goal_topic())
    robot_->publish_status((stands ? "lost " : "driving ") + std::to_string(environment_.goal(0)));
  return stands;
}

/// Forgets what was believed.
void LiveSteps::forget() {
  lost_.clear();
  watch_.reset();
}

/// Hears where the robot is sent.
void LiveSteps::take_goals() {
  const bool resets = doing_ == Doing::kReset;  // the environment has what was before
  robot_->take_goals([&](int& sent) -> std::string {
    if (!driven_) return "no policy_service drives the robot";
    if (!resets && environment_.done()) return "the policy_service has done its tasks";
    const int goal = sent = nearest(sent);
    if (goal_ && *goal_ != goal) robot_->publish_status_once("replaced " + std::to_string(*goal_));
    const bool under_way = !resets && !environment_.awaits_goal() && environment_.goal(0) == goal;
    goal_ = under_way ? std::nullopt : std::optional(goal);
    return "";
  });
}

/// Returns the place of the task's route that is nearest to a place.
int LiveSteps::nearest(int place) const {
  const int first = static_cast<int>(settings_.first_frame()), last = first + static_cast<int>(settings_.frames()) - 1;
  return std::clamp(place, first, last);
}

/// Tells what became of the robot's goals. `began`: where an episode is under way, it has just begun.
void LiveSteps::publish_progress(bool began) {
  for (const Environment::Episode& episode : environment_.finished()) {
    const bool out_of_steps = episode.steps >= static_cast<int>(settings_.max_steps());
    const char* end = episode.completed ? "arrived " : out_of_steps ? "failed " : "replaced ";
    robot_->publish_status(end + std::to_string(episode.goal));
  }
  if (environment_.awaits_goal())
    robot_->publish_status("waiting");
  else if (!environment_.done() && (began || !environment_.finished().empty()))
    robot_->publish_status("driving " + std::to_string(environment_.goal(0)));
}

}  // namespace citylearn
