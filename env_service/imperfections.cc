// SPDX-License-Identifier: Apache-2.0
#include "env_service/imperfections.h"

#include <CLI/CLI.hpp>
#include <algorithm>

#include "core/wire/service.h"

namespace citylearn {
namespace {

// They name the random numbers.
enum Stream : std::uint64_t { kSlips = 201, kDroppedFrames, kKidnappings };

}  // namespace

void add_imperfection_options(CLI::App& app, Imperfections& imperfections, const std::string& group) {
  const OptionGroup options(app, group);
  const auto probability = [&](const char* name, double& value, const char* help) {
    app.add_option(name, value, help)->capture_default_str()->check(CLI::Range(0.0, 1.0))->type_name("P");
  };
  probability("--slip", imperfections.slip,
              "Probability that an action slips: it is done never or twice, which are as likely");
  probability("--dropped-frames", imperfections.dropped_frames,
              "Probability that after a step the agent sees the frame that it saw before");
  app.add_option("--kidnappings", imperfections.kidnappings,
                 "How often in each episode the agent is carried to another place, never its goal, without being told")
      ->capture_default_str()
      ->check(CLI::Range(0, 1000))
      ->type_name("N");
}

Traversal imperfect(Traversal traversal, const Imperfections& imperfections) {
  const std::string world = world_of(imperfections);
  if (!world.empty()) traversal.name = name_in_world(traversal.name, world);
  return traversal;
}

Mishaps::Mishaps(const Imperfections& imperfections, std::uint64_t seed, std::uint64_t number)
    : slip_(imperfections.slip),
      dropped_frames_(imperfections.dropped_frames),
      kidnappings_(imperfections.kidnappings),
      slips_{seed, number, kSlips},
      drops_{seed, number, kDroppedFrames},
      kidnaps_{seed, number, kKidnappings} {}

int Mishaps::times_done() {
  if (slip_ <= 0) return 1;
  const double drawn = slips_.uniform();
  return drawn >= slip_ ? 1 : drawn < slip_ / 2 ? 0 : 2;
}

bool Mishaps::frame_dropped() { return dropped_frames_ > 0 && drops_.uniform() < dropped_frames_; }

void Mishaps::plan_kidnappings(int distance) {
  left_ = kidnappings_;
  await_kidnapping(distance);
}

void Mishaps::await_kidnapping(int distance) {
  if (left_ == 0) return;
  wait_ = 1 + static_cast<int>(kidnaps_.below(static_cast<std::uint64_t>(std::max(1, distance - 1))));
}

int Mishaps::state_kidnapped_to(std::span<const int> excluded, int states) {
  const int others = states - static_cast<int>(excluded.size());
  if (others < 1) return -1;
  --left_;
  int state = static_cast<int>(kidnaps_.below(static_cast<std::uint64_t>(others)));
  for (const int other : excluded) state += state >= other;
  return state;
}

}  // namespace citylearn
