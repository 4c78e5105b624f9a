// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <filesystem>
#include <iostream>
#include <thread>

#include "core/exchange/timing.h"
#include "core/metrics/exposition.h"
#include "core/wire/service.h"
#include "dashboard/api/api.h"
#include "dashboard/http/server.h"
#include "dashboard/live/json.h"
#include "dashboard/live/live.h"
#include "dashboard/live/route_archive.h"
#include "dashboard/live/runs_feed.h"
#include "dashboard/playback.h"
#include "dashboard/store/recorder.h"

namespace {

using namespace citylearn;

const std::string kAllRuns = "all";

struct CommandLine {
  ServerOptions server;
  std::vector<std::string> allow_hosts;
  std::string store = "runs/dashboard.sqlite";
  CLI::Option* store_option = nullptr;
  std::vector<std::string> open;
  std::string speed = "1";
  bool leave = false;
  Node::Options node;
};

/// Returns the folder of the page: beside this program (build) or share/citylearn/page (installation).
std::string page_of_program() {
  std::error_code none;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", none);
  if (none) return "";
  const auto installed = program.parent_path().parent_path() / "share/citylearn/page";
  return std::filesystem::is_directory(installed, none) ? installed : program.parent_path() / "page";
}

void add_options(CLI::App& app, CommandLine& line) {
  app.option_defaults()->group("Web server");
  ServerOptions& server = line.server;
  server.page = page_of_program();
  app.add_option("--listen", server.listen, "Address; any but this machine's own needs --token-file")
      ->capture_default_str();
  app.add_option("--port", server.port, "0 picks a free one")->capture_default_str();
  app.add_option("--page", server.page, "Folder of the built page")->capture_default_str();
  app.add_option("--token-file", server.token_file, "File with the token that clients need; created if missing");
  app.add_option("--allow-host", line.allow_hosts, "Further host names under which it may be reached: NAME,...")
      ->delimiter(',');
  app.add_option("--tls-cert", server.tls_certificate, "Certificate chain, PEM: HTTPS instead of HTTP");
  app.add_option("--tls-key", server.tls_key, "Key of the certificate, PEM");
  app.option_defaults()->group("Records");
  line.store_option =
      app.add_option("--store", line.store, "Database file of all records; created if missing")->capture_default_str();
  app.add_option("--open", line.open,
                 "Play recordings (citylearn record) instead of showing live services; without --store nothing is kept")
      ->type_name("FILE.mcap ...");
  app.add_option("--speed", line.speed, "Speed of recordings, relative to real time; max: as fast as possible")
      ->capture_default_str();
  app.add_flag("--leave", line.leave, "Unregister on exit, so env_services stop buffering episodes");
  line.node.service = "dashboard";
  line.node.id = "dashboard";
  line.node.session = kAllRuns;
  add_node_options(app, line.node);
  add_metrics_option(app, line.node);
  add_memory_option(app);
  app.get_option("--session")->description("Session to show and record, or all of the domain's");
}

/// Raises the limit of open files: a thousand clients and the middleware need more than the usual 1,024.
void allow_many_files() {
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0) return;
  files.rlim_cur = std::max<rlim_t>(files.rlim_cur, std::min<rlim_t>(files.rlim_max, 4096));
  setrlimit(RLIMIT_NOFILE, &files);
}

std::unique_ptr<Store> open_store(const std::string& path) {
  const auto folder = std::filesystem::path(path).parent_path();
  std::error_code wrong;
  if (!folder.empty()) std::filesystem::create_directories(folder, wrong);
  if (wrong) throw Error("cannot create its folder: " + wrong.message(), "--store " + path);
  return std::make_unique<Store>(Store::Options{path, 0});
}

/// Returns the lines of /metrics that the server does not have.
std::string metrics(const std::atomic<std::uint64_t>& recorded, const std::atomic<bool>& failing) {
  Exposition lines;
  lines.single("citylearn_dashboard_episodes_total", "Episodes recorded by this process.",
               static_cast<double>(recorded));
  lines.single("citylearn_dashboard_recording", "Whether the store can be written.", failing ? 0 : 1);
  return lines.text();
}

/// Passes the messages that the node takes to all listeners.
template <class Message, class... Listeners>
void dispatch(Node& node, Message& message, Listeners&... listeners) {
  while (node.take(message)) (listeners.on_message(message), ...);
}

/// The parts that watch the domain and answer from what they have seen.
struct Watch {
  Watch(const CommandLine& line, Hub& hub)
      : temporary(!line.open.empty() && line.store_option->count() == 0 ? std::make_unique<TemporaryFolder>()
                                                                        : nullptr),
        playback(line.open.empty()
                     ? nullptr
                     : std::make_unique<Playback>(line.node.middleware.domain,
                                                  ReplayOptions{line.open, replay_speed(line.speed), {}, ""})),
        store(open_store(temporary ? temporary->path() + "/dashboard.sqlite" : line.store)),
        node(line.node),
        recorder(node, *store),
        live(node, hub, live_options()),
        archive(RouteStore(*store), live),
        api({node.middleware_name(), line.node.session.empty() ? kAllRuns : line.node.session,
             line.node.middleware.domain, [this] { return !failing; }, kRunSilence.count(), playback != nullptr},
            *store, &live) {
    live.on_event = [this](const Event& event) { store->record(event); };
    recorder.on_event = [this](const Event& event) { live.publish(event); };
  }

  /// Handles the messages that have arrived and does what is due.
  void turn() {
    if (playback) heard_until = playback->now();
    dispatch(node, status, recorder, live);
    dispatch(node, traversal, recorder, live);
    dispatch(node, run, recorder, live);
    dispatch(node, stat, recorder, live);
    recorder.poll();
    live.poll();
    archive.poll();
    recorded = recorder.recorded();
    failing = recorder.failing();
    if (playback) show_messages();
  }

  void show_messages() {
    for (const std::string& text : playback->take_messages()) {
      const Event event{seconds_since_epoch(), "", node.options().id, "recording", text};
      spdlog::info("{}", text);
      live.publish(event);
      try {
        store->record(event);
      } catch (const Error& error) {
        spdlog::error("{}", error.what());
      }
    }
  }

  std::unique_ptr<TemporaryFolder> temporary;
  std::unique_ptr<Playback> playback;
  // Taken once a turn: heartbeats that wait to be handled are of that time at least, however fast a recording is
  // played.
  std::atomic<Clock::time_point> heard_until{playback ? playback->now() : Clock::time_point()};
  std::atomic<std::uint64_t> recorded{0};
  std::atomic<bool> failing{false};
  std::unique_ptr<Store> store;
  Node node;
  Recorder recorder;
  Live live;
  RouteArchive archive;
  Api api;
  msg::ServiceStatus status;
  msg::TraversalInfo traversal;
  msg::RunInfo run;
  msg::TrainingStat stat;

 private:
  Live::Options live_options() {
    Live::Options options;
    if (playback) options.clock = [this] { return heard_until.load(); };
    return options;
  }
};

/// Tells demos that start on this machine about a dashboard that hears them (tools/citylearn/demo.sh reads it).
void publish_writer(Watch& watch, const Node::Options& node, const std::string& link) {
  const MiddlewareOptions& dds = node.middleware;
  const bool hears = !watch.playback && node.session.empty() && !dds.multicast && dds.security.empty() &&
                     dds.interfaces == std::vector<std::string>{"lo"};
  watch.store->publish_writer(hears ? fmt::format("{} {} {} {}\n", link, dds.domain, node.id, getpid()) : "");
}

int serve(CommandLine& line) {
  line.server.allow_hosts.insert(line.allow_hosts.begin(), line.allow_hosts.end());
  if (line.node.session == kAllRuns) line.node.session.clear();  // as the node spells it
  allow_many_files();
  if (!line.open.empty()) line.node.middleware.name = "inprocess";
  ClientHub hub;
  // Before the server: the node's sockets then have low numbers, whatever clients do.
  Watch watch(line, hub);
  Server server(line.server, hub,
                {[&](const Query& query) { return watch.api.answer(query); },
                 [&] { return metrics(watch.recorded, watch.failing) + watch.node.metrics().text(); },
                 [&](bool alarms) { return watch.node.metrics().problem(alarms); }});
  const RunsFeed runs(hub, [&] { return watch.api.runs(); });
  std::cout << "dashboard: " << server.link() << std::endl;
  publish_writer(watch, line.node, server.link());
  watch.node.report(msg::RUNNING, "serving " + server.url());
  while (!stop_requested()) {
    watch.turn();
    if (!watch.playback) std::this_thread::sleep_for(kDashboardTurn);
    watch.node.wait(std::min({watch.recorder.due(), watch.live.due(), Clock::now() + kStopCheckInterval}));
  }
  watch.recorder.finish(line.leave);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Shows services, agents and training live on a web page, and records them.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return serve(line); });
}
