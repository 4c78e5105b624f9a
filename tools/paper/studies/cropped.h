// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "env_service/images/images.h"

namespace citylearn::paper {

/// Returns a vertical window of each picture: it begins at `left` and is `width` wide, both shares of the picture's
/// width with a sum of at most 1. So a camera with a narrower lens, turned or moved aside, would see distant things.
std::shared_ptr<Images> cropped(std::shared_ptr<Images> pictures, double left, double width);

}  // namespace citylearn::paper
