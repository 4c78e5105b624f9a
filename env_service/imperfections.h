// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "core/task/imperfections.h"
#include "core/util/random.h"
#include "env_service/traversal/traversal.h"

namespace CLI {
class App;
}

namespace citylearn {

/// Adds the options of Imperfections; `group` heads them in --help.
void add_imperfection_options(CLI::App& app, Imperfections& imperfections, const std::string& group);

/// Returns the traversal with a name that tells all imperfections, "summer-slip0.1-kidnap1", so that results are not
/// mixed with those of a better world. Without imperfections it stays as it is.
Traversal imperfect(Traversal traversal, const Imperfections& imperfections);

/// Draws what befalls one agent. Each kind of mishap has random numbers of its own, so slips and dropped frames come at
/// the same steps for the same seed and number, whichever other kinds there are and whatever the agent does.
class Mishaps {
 public:
  Mishaps() = default;  ///< None happen.
  /// `number`: of the agent, or of the task in mode EVALUATE.
  Mishaps(const Imperfections& imperfections, std::uint64_t seed, std::uint64_t number);

  /// Returns how often the next action is done: once, or when it slips never or twice, which are as likely.
  int times_done();
  /// Returns whether the camera gives no new frame after this step.
  bool frame_dropped();

  /// Plans the kidnappings of an episode that begins `distance` steps from its goal.
  void plan_kidnappings(int distance);
  /// Plans the next one, if any is left, for an agent `distance` steps from its goal: after 1 .. distance - 1 steps (1
  /// where the distance is 1), each number as likely, so that the agent is rarely at the goal before.
  void await_kidnapping(int distance);
  /// Call it after each step that does not end the episode. Returns whether the agent is carried away now.
  bool kidnapped() { return left_ > 0 && --wait_ <= 0; }
  /// Returns the state to which it is carried: any of so many but the `excluded` (in ascending order), each as likely;
  /// -1 where there is none.
  int state_kidnapped_to(std::span<const int> excluded, int states);

 private:
  double slip_ = 0, dropped_frames_ = 0;
  int kidnappings_ = 0;
  Random slips_, drops_, kidnaps_;
  int left_ = 0, wait_ = 0;  ///< kidnappings left in the episode, and steps until the next
};

}  // namespace citylearn
