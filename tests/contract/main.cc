// SPDX-License-Identifier: Apache-2.0
// The contract tests of all plug-ins, also of those that --plugin FILE,... loads (docs/how-to/load-a-plugin.md).
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <iostream>

#include "core/plugin/plugins.h"
#include "core/util/error.h"

int main(int argc, char** argv) {
  try {
    CLI::App app;
    citylearn::add_plugin_option(app, argc, argv);  // before GoogleTest asks which plug-ins there are
  } catch (const citylearn::Error& error) {
    std::cerr << "contract_plugins: " << error.what() << std::endl;
    return 1;
  }
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
