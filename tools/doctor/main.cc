// SPDX-License-Identifier: Apache-2.0
// citylearn doctor: shows reachable services and diagnoses problems of the network.
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <iostream>

#include "core/wire/service.h"
#include "tools/doctor/findings.h"

namespace {

using namespace citylearn;

const std::string kAllSessions = "all";

struct CommandLine {
  double seconds = 5;
  std::string service;
  bool json = false;
  Node::Options node;
};

void add_options(CLI::App& app, CommandLine& line) {
  app.option_defaults()->group("Doctor");
  app.add_option("--seconds", line.seconds, "How long to listen; with --service the longest wait")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 3600.0));
  app.add_option("--service", line.service,
                 "Check the health of the service with this id: succeeds when it is heard and has not failed");
  app.add_flag("--json", line.json, "Print the findings as JSON");
  spdlog::set_level(spdlog::level::off);  // the findings contain everything; --log-level overrides this
  line.node.service = line.node.id = "doctor";
  line.node.session = kAllSessions;
  add_node_options(app, line.node);
  app.get_option("--session")->description("Session to look at, or 'all' of the domain");
}

int examine(const CommandLine& line) {
  const std::string session = line.node.session == kAllSessions ? "" : line.node.session;
  if (!line.service.empty()) {
    const std::string trouble = doctor::check_service(line.node.middleware, session, line.service, line.seconds);
    if (!trouble.empty()) throw Error(trouble);
    return 0;
  }
  const doctor::Findings findings = doctor::examine(line.node.middleware, session, line.seconds);
  std::cout << (line.json ? doctor::as_json(findings) : doctor::as_text(findings)) << std::flush;
  return findings.problems.empty() ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Shows the reachable services of a DDS domain and diagnoses problems. Exit status 0: no problems.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return examine(line); });
}
