#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>

#include "core/service.h"
#include "dashboard/server.h"

namespace {

using namespace citylearn;

struct CommandLine {
  ServerOptions server;
  std::vector<std::string> allow_hosts;
  Node::Options node;
};

/// Where the build puts the page: beside this program.
std::string page_beside_program() {
  std::error_code none;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", none);
  return none ? "" : (program.parent_path() / "page").string();
}

void add_options(CLI::App& app, CommandLine& line) {
  const std::string group = "Web server";
  ServerOptions& server = line.server;
  server.page = page_beside_program();
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
  line.node.service = "dashboard";
  line.node.id = "dashboard";
  add_node_options(app, line.node);
}

/// A thousand clients and the wire's own files are more than the usual 1,024.
void allow_many_files() {
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0) return;
  files.rlim_cur = std::max<rlim_t>(files.rlim_cur, std::min<rlim_t>(files.rlim_max, 4096));
  setrlimit(RLIMIT_NOFILE, &files);
}

Answer answer(const CommandLine& line, const Query& query) {
  if (query.path != std::vector<std::string>{"about"}) return error_answer(404, "there is no such thing under /api/");
  const nlohmann::json about = {{"version", version()},
                                {"vendor", line.node.middleware.name},
                                {"run", line.node.run},
                                {"domain", line.node.middleware.domain}};
  return {200, "application/json", about.dump(), {}};
}

int serve(CommandLine& line) {
  line.server.allow_hosts.insert(line.allow_hosts.begin(), line.allow_hosts.end());
  allow_many_files();
  Node node(line.node);  // before the server: its sockets then have low numbers, whatever clients do
  ClientHub hub;
  Server server(line.server, hub, {[&line](const Query& query) { return answer(line, query); }, {}});
  std::cout << "dashboard: " << server.link() << std::endl;
  node.report(msg::RUNNING, "serving " + server.url());
  while (!stop_requested()) node.wait(Clock::now() + std::chrono::milliseconds(50));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Shows a run's services, agents and learning on a web page, live, and keeps its records.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return serve(line); });
}
