// SPDX-License-Identifier: Apache-2.0
// Runs the tests of a program in simulation.
#include <gtest/gtest.h>

#include "tests/simulation/services/programs.h"

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  return citylearn::simulation::run_simulated([] { return RUN_ALL_TESTS(); });
}
