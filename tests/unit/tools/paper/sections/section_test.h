// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <utility>

#include "tests/support/processes/service.h"
#include "tools/paper/sections/sections.h"

namespace citylearn::paper {

/// A section of the quick report, planned and computed in a folder of its own.
class SectionTest : public ::testing::Test {
 protected:
  explicit SectionTest(const std::string& name)
      : work_(folder_ / "work"),
        section_(*std::find_if(sections().begin(), sections().end(),
                               [&](const Section& section) { return section.name == name; })) {}

  Context context(World& world, World& drawn) {
    return {.world = world,
            .drawn = drawn,
            .work = work_,
            .output = folder_.path(),
            .quick = true,
            .effort = 0.01,
            .seeds = {1, 2},
            .agents = {}};
  }

  const testing::Folder folder_;
  Work work_;
  const Section& section_;
};

}  // namespace citylearn::paper
