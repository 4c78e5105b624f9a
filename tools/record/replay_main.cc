// SPDX-License-Identifier: Apache-2.0
// citylearn replay: plays MCAP recordings to a dashboard.
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "core/recording/replayer.h"
#include "core/wire/service.h"

namespace {

using namespace citylearn;

const std::string kAsRecorded = "as-recorded";

struct CommandLine {
  ReplayOptions replay;
  std::string speed = "1";
  Node::Options node;
};

void add_options(CLI::App& app, CommandLine& line) {
  app.option_defaults()->group("Recording");
  app.add_option("files", line.replay.files, "Recordings, one after the other")->type_name("FILE.mcap ...")->required();
  app.add_option("--speed", line.speed,
                 "Speed, as a multiple of the recorded one; max: as fast as the readers can follow")
      ->capture_default_str();
  app.add_option("--topics", line.replay.topics,
                 "Play only these topics: scene,action,...; by default those that command nothing")
      ->delimiter(',');
  line.node.service = line.node.id = "replay";
  line.node.session = kAsRecorded;
  add_node_options(app, line.node);
  app.get_option("--session")->description("Session to publish in");
}

int replay(CommandLine& line) {
  if (line.node.session != kAsRecorded) line.replay.session = line.node.session;
  line.replay.speed = replay_speed(line.speed);
  line.node.middleware.participant = line.node.id;
  const std::unique_ptr<Middleware> middleware = create_middleware(line.node.middleware);
  Replayer replayer(*middleware, line.replay);
  spdlog::info("plays {}", line.replay.files.front());
  while (!stop_requested() && replayer.poll()) middleware->wait(replayer.due());
  const ReplayFigures& figures = replayer.figures();
  for (const std::string& remark : figures.remarks) spdlog::warn("{}", remark);
  for (const auto& [what, count] : figures.skipped) spdlog::warn("{} messages skipped: {}", count, what);
  for (const auto& [topic, count] : figures.played)
    std::printf("%-36s %10llu messages\n", topic.c_str(), static_cast<unsigned long long>(count));
  std::printf("%.1f s, %.3f MB\n", figures.seconds, static_cast<double>(figures.bytes) / 1e6);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Plays recordings to a dashboard.", [&](CLI::App& app) { add_options(app, line); },
      [&] { return replay(line); });
}
