// SPDX-License-Identifier: Apache-2.0
// A dashboard without a page: recorder_process MIDDLEWARE DOMAIN STORE. Leaves at SIGTERM.
#include <spdlog/spdlog.h>

#include <csignal>
#include <cstdio>
#include <string>

#include "dashboard/store/recorder.h"
#include "tests/support/options.h"

namespace {

volatile std::sig_atomic_t stopped = 0;

template <class Message>
void hand_on(citylearn::Node& node, citylearn::Recorder& recorder) {
  Message message;
  while (node.take(message)) recorder.on_message(message);
}

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
  while (!stopped) {
    node.wait(std::min(recorder.due(), Clock::now() + std::chrono::milliseconds(100)));
    hand_on<msg::ServiceStatus>(node, recorder);
    hand_on<msg::TraversalInfo>(node, recorder);
    hand_on<msg::RunInfo>(node, recorder);
    hand_on<msg::TrainingStat>(node, recorder);
    recorder.poll();
  }
  recorder.finish(false);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "recorder_process: %s\n", error.what());
  return 1;
}
