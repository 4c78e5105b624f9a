// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/drawing.h"

#include "core/util/error.h"
#include "tools/paper/child.h"

namespace citylearn::paper {
namespace {

bool convert(std::vector<std::string> options) {
  options.insert(options.begin(), "rsvg-convert");
  try {
    return Child(options, "/dev/null").wait() == 0;
  } catch (const Error&) {
    return false;  // it is not there
  }
}

}  // namespace

bool can_draw() { return convert({"--version"}); }

bool draw(const std::string& svg, const std::string& png) {
  return convert({"--zoom", "2", "--background-color", "white", "--output", png, svg});
}

}  // namespace citylearn::paper
