// SPDX-License-Identifier: Apache-2.0
// citylearn ros2: a session or a recording in the messages of ROS 2.
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "core/exchange/timing.h"
#include "core/recording/ros2_bag_writer.h"
#include "core/ros2/participant.h"
#include "core/util/wall_clock.h"
#include "core/wire/service.h"
#include "tools/ros2/bridge.h"
#include "tools/ros2/conversion.h"

namespace {

using namespace citylearn;

constexpr std::uint64_t kFlushInterval = 1'000'000'000;  // nanoseconds

/// Writes messages into a bag.
class Ros2File : public Ros2Sink {
 public:
  /// Throws Error naming the file when it is there already or cannot be made.
  explicit Ros2File(const std::string& path) : writer_(path) {}
  void publish(const Ros2Message& message) override {
    std::uint16_t& channel = channels_[message.topic];
    if (channel == 0) channel = writer_.add(message.topic, *message.type);
    writer_.write(channel, message.time, message.data);
    ++counts_[message.topic];
  }
  /// Writes what has waited for a second.
  void poll() {
    if (const std::uint64_t since = writer_.waiting_since();
        since != 0 && nanoseconds_since_epoch() - since >= kFlushInterval)
      writer_.flush();
  }
  /// Writes all that is left, and the summary.
  void close() { writer_.close(); }

  std::uint64_t bytes() const { return writer_.bytes(); }
  const std::map<std::string, std::uint64_t>& counts() const { return counts_; }  ///< messages by topic

 private:
  Ros2BagWriter writer_;
  std::map<std::string, std::uint16_t> channels_;  // by topic
  std::map<std::string, std::uint64_t> counts_;
};

struct CommandLine {
  std::vector<std::string> open;
  std::string output;
  Ros2Options ros = ros2_defaults();
  Ros2Bridge::Options bridge;
  Node::Options node;
  CLI::Option* session = nullptr;
};

void add_options(CLI::App& app, CommandLine& line) {
  Ros2Translation::Options& translation = line.bridge.translation;
  app.option_defaults()->group("ROS 2");
  app.add_option("--open", line.open, "Convert recordings (citylearn record) instead of a running session")
      ->type_name("FILE.mcap ...");
  app.add_option("--output", line.output, "Write an MCAP file with profile ros2 instead of publishing")
      ->type_name("FILE.mcap");
  add_ros2_options(app, line.ros);
  for (const char* file : {"--open", "--output"}) app.get_option("--use-sim-time")->excludes(file);
  app.add_option("--prefix", translation.prefix, "Begins all topics: /PREFIX/ENVIRONMENT/agent_0/...")
      ->capture_default_str()
      ->check([](const std::string& name) {
        const bool valid =
            !name.empty() && std::isalpha(static_cast<unsigned char>(name[0])) &&
            std::ranges::all_of(name, [](unsigned char letter) { return std::isalnum(letter) || letter == '_'; });
        return valid ? "" : "'" + name + "' is not a name of ROS 2: a letter, then letters, digits and '_'";
      });
  app.add_option("--agents", translation.agents, "Agents of each env_service that are shown")
      ->capture_default_str()
      ->check(CLI::Range(1u, msg::MAX_AGENTS));
  app.add_flag("--actions", line.bridge.actions,
               "Publish actions, cmd_vel and rewards too: reads each observation, which slows a training down");
  app.add_option("--rate", translation.rate,
                 "How often what agents see is shown, times a second; 0: each step. More than 10 need --actions")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e4));
  app.add_option("--speed", translation.speed, "Of a step in cmd_vel, m/s")->capture_default_str();
  app.add_option("--picture-width", line.bridge.widest, "Pixels; wider pictures are made smaller")
      ->capture_default_str()
      ->check(CLI::Range(16, 8192));
  line.node.service = line.node.id = "ros2_bridge";
  add_node_options(app, line.node);
  add_metrics_option(app, line.node);
  line.session = app.get_option("--session");
}

void print(const Ros2File& file, const std::string& path) {
  for (const auto& [topic, count] : file.counts())
    std::printf("%-56s %10llu messages\n", topic.c_str(), static_cast<unsigned long long>(count));
  std::printf("%s: %.3f MB\n", path.c_str(), 1e-6 * static_cast<double>(file.bytes()));
}

int convert(const CommandLine& line) {
  if (line.output.empty()) throw Error("needs a file to write", "--open", "add --output FILE.mcap");
  Ros2File file(line.output);
  const std::string session = line.session->count() > 0 ? line.node.session : "";
  Ros2ConversionResult result;
  try {
    result = citylearn::convert({line.open, session, line.bridge.widest, line.bridge.translation}, file);
  } catch (const Error&) {
    file.close();
    if (file.counts().empty())
      std::filesystem::remove(line.output);
    else
      spdlog::warn("{} has only what came before that", line.output);
    throw;
  }
  file.close();
  if (!file.counts().empty()) print(file, line.output);
  if (result.unreadable > 0) spdlog::warn("{} messages cannot be decoded and are left out", result.unreadable);
  if (result.missing_pictures > 0)
    spdlog::warn(
        "{} of {} pictures are not in the recording: it has those that somebody asked for. Without --open, --output "
        "records all",
        result.missing_pictures, result.missing_pictures + result.pictures);
  if (!file.counts().empty()) return 0;
  std::filesystem::remove(line.output);
  if (session.empty()) throw Error("has nothing to convert", line.open.front(), "record observations or scenes");
  throw Error("has nothing of session '" + session + "' to convert", line.open.front(),
              "leave --session out to convert all sessions");
}

/// Translates the session until the end is requested. `poll` does what is due on the other side.
template <class Poll>
void run(const CommandLine& line, Ros2Sink& sink, const std::string& activity, Poll poll) {
  Node node(line.node);
  Ros2Bridge bridge(node, sink, line.bridge);
  node.report(msg::RUNNING, activity);
  spdlog::info("{}", activity);
  const Clock::time_point patience = Clock::now() + kSilence;
  bool told = false;
  while (!stop_requested()) {
    node.wait(bridge.due());
    poll();
    bridge.poll();
    if (told || Clock::now() < patience) continue;
    told = true;
    if (bridge.environments() == 0)
      spdlog::warn(
          "no env_service yet in session '{}', domain {}: have others the same --session, --domain and --interface?",
          line.node.session, line.node.middleware.domain);
  }
}

int bridge(CommandLine& line) {
  if (!line.output.empty()) {
    Ros2File file(line.output);
    run(line, file, "records to " + line.output, [&] { file.poll(); });
    file.close();
    print(file, line.output);
    return 0;
  }
  if (!line.node.middleware.security.empty())
    spdlog::warn("--security holds for CityLearn's side: ROS 2's is not encrypted");
  Ros2Participant participant(line.ros, line.node.id, &line.node.middleware);
  line.bridge.time = [&] { return participant.clock().time(); };
  run(line, participant, "publishes to ROS 2 in domain " + std::to_string(line.ros.domain), [&] {
    for (const std::string& fault : participant.poll()) spdlog::error("{}", fault);
  });
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Says what agents see and do in the messages of ROS 2: on DDS, or in an MCAP file.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return line.open.empty() ? bridge(line) : convert(line); });
}
