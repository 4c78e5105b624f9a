// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "env_service/environment.h"
#include "tools/paper/work.h"

namespace citylearn::paper {

/// Places that an episode comes by, from `start`: `path` has its actions as EpisodeStat does. Throws Error when they
/// lead off the route.
std::vector<int> places_walked(int start, int steps, std::span<const std::uint8_t> path, const std::vector<int>& turns,
                               int places);

/// The one episode of a trial that is shown as pictures: of its first 20 tasks the one with the longest way, the first
/// of those. Tasks are numbered and the same for everybody, so everybody's walk has the same start and goal.
/// Outcome: {"task", "goal", "completed", "frames"}: where it stood, from the start on, as indices on the traversal.
/// `episodes` by task, at least one, on a traversal of so many frames without turns.
Json walk_of(const std::vector<Environment::Episode>& episodes, int frames);

/// Which of `count` frames are shown as `most` pictures: the first, the last, and as evenly as can be between.
std::vector<int> spread(int count, int most);

/// One row of pictures under a line of text.
struct Strip {
  std::string text;
  std::vector<int> frames;               ///< indices on `traversal`
  std::vector<std::string> labels;       ///< below each picture
  const Traversal* traversal = nullptr;  ///< has images
};

/// The strips one under the other, as the bytes of a PNG. Throws Error when a picture cannot be read.
std::string png_of(const std::vector<Strip>& strips);

}  // namespace citylearn::paper
