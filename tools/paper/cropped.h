// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "env_service/dataset_io/images.h"

namespace citylearn::paper {

/// A part of each picture, of its whole height: from `left` on, `width` wide, both shares of its width, 0..1 together
/// at most. What a camera with a narrower lens, turned or moved to the side, would have seen of things far away.
std::shared_ptr<Images> cropped(std::shared_ptr<Images> pictures, double left, double width);

}  // namespace citylearn::paper
