// SPDX-License-Identifier: Apache-2.0
// A dashboard without a page: recorder_process --store FILE, and the options of every service.
#include <CLI/CLI.hpp>
#include <iostream>

#include "core/wire/service.h"
#include "dashboard/store/recorder.h"
#include "tests/support/records/record_until.h"

int main(int argc, char** argv) {
  using namespace citylearn;
  NodeOptions options;
  options.service = options.id = "dashboard";
  std::string file;
  const auto setup = [&](CLI::App& app) {
    app.add_option("--store", file, "SQLite file")->required();
    add_node_options(app, options);
  };
  return service_main(argc, argv, "Records episodes and training figures.", setup, [&] {
    Store store({file, 0});
    Node node(options);
    Recorder recorder(node, store);
    node.report(msg::RUNNING, "records");
    std::cout << "records" << std::endl;
    testing::record_until(node, recorder, stop_requested);
    return 0;
  });
}
