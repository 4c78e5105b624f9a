// SPDX-License-Identifier: Apache-2.0
// A dashboard without a page: recorder_process MIDDLEWARE DOMAIN STORE. Leaves at SIGTERM.
#include <spdlog/spdlog.h>

#include <csignal>
#include <cstdio>
#include <string>

#include "dashboard/store/recorder.h"
#include "tests/support/options.h"
#include "tests/support/records/record_until.h"

namespace {

volatile std::sig_atomic_t stopped = 0;

}  // namespace

int main(int argc, char** argv) try {
  using namespace citylearn;
  if (argc != 4) throw Error("needs MIDDLEWARE DOMAIN STORE");
  std::signal(SIGTERM, [](int) { stopped = 1; });
  Store store({argv[3], 0});
  Node node({citylearn::testing::middleware_options(argv[1], static_cast<std::uint32_t>(std::stoul(argv[2]))),
             "dashboard", "dashboard", "default"});
  Recorder recorder(node, store);
  node.report(msg::RUNNING, "records");
  std::puts("records");
  std::fflush(stdout);
  citylearn::testing::record_until(node, recorder, [] { return stopped != 0; });
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "recorder_process: %s\n", error.what());
  return 1;
}
