// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <filesystem>
#include <iostream>
#include <optional>

#include "core/wire/service.h"
#include "dashboard/api/api.h"
#include "dashboard/http/server.h"
#include "dashboard/live/live.h"
#include "dashboard/live/playback.h"
#include "dashboard/live/runs_feed.h"
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
  std::string recognition;
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
                 "Show recordings (citylearn record) instead of live services; without --store nothing is kept")
      ->type_name("FILE.mcap ...");
  app.add_option("--speed", line.speed, "Speed of recordings relative to real time; max: as fast as possible")
      ->capture_default_str();
  app.add_option("--recognition", line.recognition,
                 "Folder of place-recognition results, as `citylearn vpr` writes them");
  app.add_flag("--leave", line.leave, "Unregister on exit, so env_services stop buffering episodes");
  line.node.service = "dashboard";
  line.node.id = "dashboard";
  line.node.session = kAllRuns;
  add_node_options(app, line.node);
  add_metrics_option(app, line.node);
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
  return "# HELP citylearn_dashboard_episodes_total Episodes recorded by this process.\n"
         "# TYPE citylearn_dashboard_episodes_total counter\ncitylearn_dashboard_episodes_total " +
         std::to_string(recorded) +
         "\n# HELP citylearn_dashboard_recording Whether the store can be written.\n"
         "# TYPE citylearn_dashboard_recording gauge\ncitylearn_dashboard_recording " +
         (failing ? "0\n" : "1\n");
}

/// Passes the messages that the node takes to all listeners.
template <class Message, class... Listeners>
void dispatch(Node& node, Message& message, Listeners&... listeners) {
  while (node.take(message)) (listeners.on_message(message), ...);
}

int serve(CommandLine& line) {
  line.server.allow_hosts.insert(line.allow_hosts.begin(), line.allow_hosts.end());
  if (line.node.session == kAllRuns) line.node.session.clear();  // as the node spells it
  allow_many_files();
  std::optional<TemporaryFolder> temporary;
  std::optional<Playback> playback;
  if (!line.open.empty()) {
    line.node.middleware.name = "inprocess";
    if (line.store_option->count() == 0) line.store = temporary.emplace().path() + "/dashboard.sqlite";
    playback.emplace(line.node.middleware.domain, ReplayOptions{line.open, replay_speed(line.speed), {}, ""});
  }
  const std::unique_ptr<Store> store = open_store(line.store);
  Node node(line.node);  // before the server: its sockets then have low numbers, whatever clients do
  ClientHub hub;
  Recorder recorder(node, *store);
  Live live(node, hub);
  live.on_event = [&store](const Event& event) { store->record(event); };
  recorder.on_event = [&live](const Event& event) { live.publish(event); };
  std::atomic<std::uint64_t> recorded{0};
  std::atomic<bool> failing{false};
  Api api({node.middleware_name(), line.node.session.empty() ? kAllRuns : line.node.session,
           line.node.middleware.domain, line.recognition, [&failing] { return !failing; }},
          *store, &live);
  Server server(line.server, hub,
                {[&api](const Query& query) { return api.answer(query); },
                 [&] { return metrics(recorded, failing) + node.metrics().text(); },
                 [&node](bool alarms) { return node.metrics().problem(alarms); }});
  const RunsFeed runs(hub, [&api] { return api.runs(); });
  std::cout << "dashboard: " << server.link() << std::endl;
  node.report(msg::RUNNING, "serving " + server.url());

  msg::ServiceStatus status;
  msg::TraversalInfo traversal;
  msg::RunInfo run;
  msg::TrainingStat stat;
  while (!stop_requested()) {
    dispatch(node, status, recorder, live);
    dispatch(node, traversal, recorder, live);
    dispatch(node, run, recorder, live);
    dispatch(node, stat, recorder, live);
    recorder.poll();
    live.poll();
    for (const std::string& text : playback ? playback->take_messages() : std::vector<std::string>()) {
      const Event event{seconds_since_epoch(), "", line.node.id, "recording", text};
      spdlog::info("{}", text);
      live.publish(event);
      try {
        store->record(event);
      } catch (const Error& error) {
        spdlog::error("{}", error.what());
      }
    }
    recorded = recorder.recorded();
    failing = recorder.failing();
    node.wait(std::min({recorder.due(), live.due(), Clock::now() + std::chrono::milliseconds(50)}));
  }
  recorder.finish(line.leave);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Shows services, agents and training live on a web page, and records them.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return serve(line); });
}
