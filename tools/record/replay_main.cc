// SPDX-License-Identifier: Apache-2.0
// citylearn replay: plays MCAP recordings to a dashboard, or bags of ROS 2 to agents.
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>

#include "core/recording/replayer.h"
#include "core/task/action.h"
#include "core/wire/service.h"
#include "policy_service/run/run_options.h"
#include "tools/lab/descriptors.h"
#include "tools/record/agent_replay.h"

namespace {

using namespace citylearn;

const std::string kAsRecorded = "as-recorded";
constexpr std::size_t kPartingsShown = 10;
constexpr std::array kActionNames = {"stay", "next", "previous"};

struct CommandLine {
  ReplayOptions replay;
  AgentReplayOptions agents;
  std::string speed = "1";
  Node::Options node;
};

void add_options(CLI::App& app, CommandLine& line) {
  app.option_defaults()->group("Recording");
  app.add_option("files", line.replay.files, "Recordings, one after the other; with --agent a bag of ROS 2")
      ->type_name("FILE.mcap ...")
      ->required();
  app.add_option("--speed", line.speed,
                 "Speed, as a multiple of the recorded one; max: as fast as the readers can follow")
      ->capture_default_str();
  app.add_option("--topics", line.replay.topics,
                 "Play only these topics: scene,action,...; by default those that command nothing")
      ->delimiter(',');
  app.option_defaults()->group("Agents on a bag");
  app.add_option("--agent", line.agents.agents,
                 "Let this agent decide on each picture of the bag: a checkpoint, or a training's folder. Repeat it to "
                 "see where agents part")
      ->type_name("FILE")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  app.add_option("--output", line.agents.output, "File to write: the bag's messages and the decisions")
      ->type_name("FILE.mcap");
  app.add_option("--goal", line.agents.goal, "Place that agents go to, from 0; by default the last of their route")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--seed", line.agents.seed, "Seed of drawn actions, as policy_service's")->capture_default_str();
  add_source_option(app, line.agents.recording,
                    "An option of env_service or encoder_service for the bag, as rosbag2-camera=2; may be repeated");
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
  if (figures.played.empty() && !stop_requested())
    throw Error("holds no message that is played", line.replay.files.front(),
                "a bag of ROS 2 is for --agent; --topics names what is played");
  for (const auto& [topic, count] : figures.played)
    std::printf("%-36s %10llu messages\n", topic.c_str(), static_cast<unsigned long long>(count));
  std::printf("%.1f s, %.3f MB\n", figures.seconds, static_cast<double>(figures.bytes) / 1e6);
  return 0;
}

void print(const std::vector<AgentReplayed>& agents, const std::string& output) {
  for (const AgentReplayed& agent : agents) {
    const auto count = [&](std::uint8_t action) {
      return std::count(agent.actions.begin(), agent.actions.end(), action);
    };
    std::printf("%-24s %8zu pictures: %td next, %td previous, %td stay\n", agent.name.c_str(), agent.actions.size(),
                count(kNext), count(kPrevious), count(kStay));
  }
  if (agents.size() > 1) {
    const auto parted = partings(agents);
    std::printf("%zu times they part\n", parted.size());
    for (std::size_t i = 0; i < std::min(parted.size(), kPartingsShown); ++i) {
      const auto [first, last] = parted[i];
      std::printf("  pictures %zu to %zu, from %.3f s on:", first, last, agents[0].times[first] - agents[0].times[0]);
      for (const AgentReplayed& agent : agents)
        std::printf(" %s %s", agent.name.c_str(), kActionNames[agent.actions[first]]);
      std::printf("\n");
    }
    if (parted.size() > kPartingsShown) std::printf("  and %zu more\n", parted.size() - kPartingsShown);
  }
  std::printf("%s\n", output.c_str());
}

int decide(CommandLine& line) {
  if (line.replay.files.size() != 1) throw Error("takes one bag", "--agent");
  if (line.agents.output.empty()) throw Error("needs a file to write", "--agent", "add --output FILE.mcap");
  line.agents.bag = line.replay.files.front();
  try {
    print(replay_agents(line.agents), line.agents.output);
  } catch (const lab::Stopped&) {
    return 130;
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Plays recordings to a dashboard, or a bag of ROS 2 to agents.",
      [&](CLI::App& app) { add_options(app, line); },
      [&] { return line.agents.agents.empty() ? replay(line) : decide(line); });
}
