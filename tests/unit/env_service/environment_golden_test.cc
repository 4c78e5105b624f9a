// SPDX-License-Identifier: Apache-2.0
// Whole episodes as text, in tests/golden/environment_*.txt. A changed line is a changed task: agents and figures from
// before no longer compare. Written anew with CITYLEARN_GOLDEN=write in the environment.
#include <gtest/gtest.h>

#include <sstream>

#include "tests/support/env/env.h"
#include "tests/support/golden.h"

namespace citylearn::testing {
namespace {

std::string flags_text(std::uint8_t flags) {
  std::string text;
  if (flags & msg::FLAG_TERMINATED) text += " terminated";
  if (flags & msg::FLAG_TRUNCATED) text += " truncated";
  if (flags & msg::FLAG_FIRST) text += " first";
  if (flags & msg::FLAG_IDLE) text += " idle";
  return text;
}

/// Walks for `ticks` with a fixed, aimless choice among the allowed actions.
std::string trace(const msg::TaskSettings& with, int agents, int ticks) {
  const Traversal traversal = small_traversal(12);
  Environment environment(traversal, agents);
  environment.reset(with);
  msg::Observation seen;
  std::ostringstream text;
  std::vector<std::uint8_t> choice(agents);
  Random random(2024);
  for (int tick = 0; tick < ticks && !environment.done(); ++tick) {
    environment.observe(seen);
    text << "step " << seen.step() << "\n";
    for (int agent = 0; agent < agents; ++agent) {
      text << "  agent " << agent << " at " << seen.position()[agent] << " sees " << seen.frame()[agent] << " goal "
           << seen.goal()[agent] << " allowed" << (seen.allowed()[agent] & 1 ? " stay" : "")
           << (seen.allowed()[agent] & 2 ? " next" : "") << (seen.allowed()[agent] & 4 ? " previous" : "") << " after ";
      const int previous = seen.previous_action()[agent];
      text << (previous == kNoAction ? "-"
               : previous == kStay   ? "stay"
               : previous == kNext   ? "next"
                                     : "previous")
           << " reward " << seen.reward()[agent] << flags_text(seen.flags()[agent]) << "\n";
      // Mostly towards the goal, so that both endings occur.
      const std::uint8_t towards = seen.position()[agent] < seen.goal()[agent] ? kNext : kPrevious;
      choice[agent] = towards;
      if (random.below(10) >= 6) do
          choice[agent] = static_cast<std::uint8_t>(random.below(3));
        while (!(seen.allowed()[agent] >> choice[agent] & 1));
      if (seen.flags()[agent] & msg::FLAG_IDLE) choice[agent] = kStay;
    }
    environment.step(choice);
    for (const auto& episode : environment.finished())
      text << "  episode of agent " << episode.agent << " task " << episode.task << ": " << episode.start << " -> "
           << episode.goal << (episode.completed ? " completed" : " failed") << " in " << episode.steps
           << " steps (shortest " << episode.shortest << "), reward " << episode.reward << "\n";
  }
  return text.str();
}

TEST(EnvironmentGolden, Training) {
  msg::TaskSettings with = settings(msg::TRAIN, 6, 8, 3);
  with.first_frame() = 4;
  expect_golden("environment_training.txt", trace(with, 2, 40));
}

TEST(EnvironmentGolden, EvaluationOnShuffledFrames) {
  msg::TaskSettings with = settings(msg::EVALUATE, 12, 12, 4);
  with.tasks() = 5;
  with.shuffle() = true;
  expect_golden("environment_evaluation_shuffled.txt", trace(with, 2, 1000));
}

}  // namespace
}  // namespace citylearn::testing
