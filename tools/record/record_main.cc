// SPDX-License-Identifier: Apache-2.0
// citylearn record: writes the messages of a session to MCAP files.
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "core/exchange/timing.h"
#include "core/util/version.h"
#include "core/wire/service.h"
#include "tools/record/recording.h"

namespace {

using namespace citylearn;

const std::string kAllSessions = "all";
constexpr double kMegabyte = 1e6;

struct CommandLine {
  RecordingOptions recording;
  double split = 0;
  Node::Options node;
};

void add_options(CLI::App& app, CommandLine& line) {
  app.option_defaults()->group("Recording");
  app.add_option("--output", line.recording.output, "File to write")->type_name("FILE.mcap")->required();
  app.add_option("--topics", line.recording.topics, "Record only these topics: scene,episode_stat,...; all by default")
      ->delimiter(',');
  app.add_option("--split-mb", line.split, "Continue in FILE-2.mcap ... after this many megabytes; 0 writes one file")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e6));
  line.node.service = line.node.id = "record";
  line.node.session = kAllSessions;
  add_node_options(app, line.node);
  app.get_option("--session")->description("Session to record, or 'all' of the domain");
}

int record(CommandLine& line) {
  if (line.node.session != kAllSessions) line.recording.session = line.node.session;
  line.recording.split = static_cast<std::uint64_t>(line.split * kMegabyte);
  line.recording.library = "citylearn " + version();
  line.node.middleware.participant = line.node.id;
  const std::unique_ptr<Middleware> middleware = create_middleware(line.node.middleware);
  Recording recording(*middleware, line.recording);
  spdlog::info("records to {}", line.recording.output);
  while (!stop_requested()) {
    middleware->wait(Clock::now() + kStopCheckInterval);
    recording.poll();
    for (const std::string& fault : middleware->discovery().faults()) spdlog::error("{}", fault);
  }
  recording.close();
  for (const auto& [topic, count] : recording.counts()) {
    std::printf("%-36s %10llu messages %12.3f MB\n", topic.c_str(), static_cast<unsigned long long>(count.messages),
                static_cast<double>(count.bytes) / kMegabyte);
    if (count.missed > 0) spdlog::warn("{} messages of {} came too fast and were missed", count.missed, topic);
  }
  for (const std::string& file : recording.files()) std::printf("%s\n", file.c_str());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Writes the messages of a session to an MCAP file, until Ctrl-C.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return record(line); });
}
