// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace citylearn::paper {

/// Whether this machine has rsvg-convert (Debian: librsvg2-bin), which turns SVG into PNG.
bool can_draw();

/// Draws the file `svg` into the file `png`, twice as large, on white. False when it failed.
bool draw(const std::string& svg, const std::string& png);

}  // namespace citylearn::paper
