// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "env_service/environment.h"
#include "tools/paper/work.h"

namespace citylearn::paper {

/// Returns the one episode of a trial that is shown as pictures: of its first 20 tasks the first one with the longest
/// shortest path. All agents have the same tasks, so all walks have the same start and goal.
/// Outcome: {"task", "goal", "completed", "frames"}: the frames it visited, as indices on the traversal.
/// `episodes` by task, at least one, on a traversal of so many frames.
Json walk_of(const std::vector<Environment::Episode>& episodes, int frames);

/// Returns which of `count` frames to show as `most` pictures: the first, the last, and evenly spread ones between.
std::vector<int> spread(int count, int most);

/// Returns these frames of a traversal with images side by side, each in a column of the same width, as the bytes of a
/// PNG. Throws Error when a picture cannot be read.
std::string strip_png(const Traversal& traversal, const std::vector<int>& frames);

}  // namespace citylearn::paper
