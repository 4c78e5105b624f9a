// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/training.h"

#include <gtest/gtest.h>

#include "tests/support/networks/small_city.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

TEST(NetworkTask, NeedsAllFrames) {
  Traversal city = small_city(16, 64);
  city.name = "A";
  EXPECT_EQ(network_task(city, 2, 12).reference.cols(), 12);
  EXPECT_EQ(error_of([&] { network_task(city, 6, 12); }),
            "traversal 'A': has 16 frames, the route needs frames 6..17 (choose fewer)");
}

}  // namespace
}  // namespace citylearn::testing
