// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "env_service/dataset_io/traversal.h"

// Recordings that are made from others.

namespace citylearn::paper {

/// Returns a vertical window of each picture: it begins at `left` and is `width` wide, both shares of the picture's
/// width with a sum of at most 1. So a camera with a narrower lens, turned or moved aside, would see distant things.
std::shared_ptr<Images> cropped(std::shared_ptr<Images> pictures, double left, double width);

/// Returns the share of the second traversal in frame i of a mixture: between 1/5 and 4/5, another draw each 16 frames
/// and straight lines between.
double share_of_second(int frame);

/// Returns a traversal between two of the same route: its frames are weighed means of theirs, of the pictures (the
/// second one's in the first one's size) or of the features, which keep the mean of their lengths. Throws Error unless
/// both have pictures, or features of one dimension.
Traversal mixture(const Traversal& first, const Traversal& second, const std::string& name);

}  // namespace citylearn::paper
