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

/// Where the build puts the page, beside this program, or an installation: bin/ and share/citylearn/page.
std::string page_of_program() {
  std::error_code none;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", none);
  if (none) return "";
  const auto installed = program.parent_path().parent_path() / "share/citylearn/page";
  return std::filesystem::is_directory(installed, none) ? installed : program.parent_path() / "page";
}

void add_options(CLI::App& app, CommandLine& line) {
  const std::string group = "Web server";
  ServerOptions& server = line.server;
  server.page = page_of_program();
  app.add_option("--listen", server.listen, "Address; any but this machine's own needs --token-file")
      ->capture_default_str()
      ->group(group);
  app.add_option("--port", server.port, "0 picks a free one")->capture_default_str()->group(group);
  app.add_option("--page", server.page, "Folder of the built page")->capture_default_str()->group(group);
  app.add_option("--token-file", server.token_file,
                 "File with the token that visitors need; made where it is not there")
      ->group(group);
  app.add_option("--allow-host", line.allow_hosts, "Further names it is called by: NAME,...")
      ->delimiter(',')
      ->group(group);
  app.add_option("--tls-cert", server.tls_certificate, "Certificate chain, PEM: HTTPS instead of HTTP")->group(group);
  app.add_option("--tls-key", server.tls_key, "Its key, PEM")->group(group);
  const std::string records = "Records";
  line.store_option =
      app.add_option("--store", line.store, "File with all that is recorded; made where it is not there")
          ->capture_default_str()
          ->group(records);
  app.add_option("--open", line.open,
                 "Show recordings (./run record) instead of what runs; without --store nothing of them is kept")
      ->type_name("FILE.mcap ...")
      ->group(records);
  app.add_option("--speed", line.speed, "Of recordings: times as fast as it was; max: as fast as it can be recorded")
      ->capture_default_str()
      ->group(records);
  app.add_option("--recognition", line.recognition, "Folder of place-recognition results, as `./run vpr` writes them")
      ->group(records);
  app.add_flag("--leave", line.leave, "At its end tell env_services that they need keep nothing for this dashboard")
      ->group(records);
  line.node.service = "dashboard";
  line.node.id = "dashboard";
  line.node.session = kAllRuns;
  add_node_options(app, line.node);
  app.get_option("--session")->description("Session to show and record, or all of the domain's");
}

/// A thousand clients and the wire's own files are more than the usual 1,024.
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
  if (wrong) throw Error("cannot make its folder: " + wrong.message(), "--store " + path);
  return std::make_unique<Store>(Store::Options{path, 0});
}

/// Lines for /metrics beside the server's own.
std::string metrics(const std::atomic<std::uint64_t>& recorded, const std::atomic<bool>& failing) {
  return "# HELP citylearn_dashboard_episodes_total Episodes recorded by this process.\n"
         "# TYPE citylearn_dashboard_episodes_total counter\ncitylearn_dashboard_episodes_total " +
         std::to_string(recorded) +
         "\n# HELP citylearn_dashboard_recording Whether the store can be written.\n"
         "# TYPE citylearn_dashboard_recording gauge\ncitylearn_dashboard_recording " +
         (failing ? "0\n" : "1\n");
}

/// Hands what the node takes to everyone whom it concerns.
template <class Message, class... Listeners>
void hand_on(Node& node, Message& message, Listeners&... listeners) {
  while (node.take(message)) (listeners.hear(message), ...);
}

int serve(CommandLine& line) {
  line.server.allow_hosts.insert(line.allow_hosts.begin(), line.allow_hosts.end());
  if (line.node.session == kAllRuns) line.node.session.clear();  // as the node says it
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
  live.told = [&store](const Event& event) { store->record(event); };
  recorder.told = [&live](const Event& event) { live.show(event); };
  std::atomic<std::uint64_t> recorded{0};
  std::atomic<bool> failing{false};
  Api api({node.middleware_name(), line.node.session.empty() ? kAllRuns : line.node.session,
           line.node.middleware.domain, line.recognition, [&failing] { return !failing; }},
          *store, &live);
  Server server(line.server, hub,
                {[&api](const Query& query) { return api.answer(query); }, [&] { return metrics(recorded, failing); }});
  const RunsFeed runs(hub, [&api] { return api.runs(); });
  std::cout << "dashboard: " << server.link() << std::endl;
  node.report(msg::RUNNING, "serving " + server.url());

  msg::ServiceStatus status;
  msg::TraversalInfo traversal;
  msg::RunInfo run;
  msg::TrainingStat stat;
  while (!stop_requested()) {
    hand_on(node, status, recorder, live);
    hand_on(node, traversal, recorder, live);
    hand_on(node, run, recorder, live);
    hand_on(node, stat, recorder, live);
    recorder.turn();
    live.turn();
    for (const std::string& news : playback ? playback->news() : std::vector<std::string>()) {
      const Event event{now_seconds(), "", line.node.id, "recording", news};
      spdlog::info("{}", news);
      live.show(event);
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
      argc, argv, "Shows a run's services, agents and learning on a web page, live, and keeps its records.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return serve(line); });
}
