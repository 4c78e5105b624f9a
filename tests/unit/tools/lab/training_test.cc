// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/training.h"

#include <gtest/gtest.h>

#include "tests/support/networks/small_city.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

TEST(NetworkTask, NeedsFeaturesOfOneKindOfAllFrames) {
  Traversal city = small_city(16, 64), narrow = city;
  city.name = "A";
  narrow.name = "B";
  narrow.dimension = 8;
  const auto refusal = [](const Experiences& route) { return error_of([&] { network_task(route, 0, 12); }); };
  EXPECT_EQ(network_task({&city, &city}, 0, 12).reference.cols(), 24);
  EXPECT_EQ(refusal({&city, &narrow}),
            "traversal 'B': has 8 features a frame, 'A' has 64 (train on traversals with features of one kind)");
  narrow = city;
  narrow.frames = 10;
  EXPECT_EQ(refusal({&city, &narrow}), "traversal 'A': has 10 frames, the route needs frames 0..11 (choose fewer)");
}

}  // namespace
}  // namespace citylearn::testing
