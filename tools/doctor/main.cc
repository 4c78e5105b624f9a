// SPDX-License-Identifier: Apache-2.0
// ./run doctor: what is heard on the network, and what is in its way.
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <iostream>

#include "core/wire/service.h"
#include "tools/doctor/findings.h"

namespace {

using namespace citylearn;

const std::string kAllRuns = "all";

struct CommandLine {
  double seconds = 5;
  std::string service;
  bool json = false;
  Node::Options node;
};

void add_options(CLI::App& app, CommandLine& line) {
  const std::string group = "Doctor";
  app.add_option("--seconds", line.seconds, "How long to listen; with --service: at most so long")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 3600.0))
      ->group(group);
  app.add_option("--service", line.service,
                 "Health check of the service with this id: succeeds once it was heard and has not failed")
      ->group(group);
  app.add_flag("--json", line.json, "Findings as JSON")->group(group);
  spdlog::set_level(spdlog::level::off);  // the findings say it all; --log-level says otherwise
  line.node.service = line.node.id = "doctor";
  line.node.session = kAllRuns;
  add_node_options(app, line.node);
  app.get_option("--session")->description("Session to look at, or all of the domain's");
}

int examine(const CommandLine& line) {
  const std::string run = line.node.session == kAllRuns ? "" : line.node.session;
  if (!line.service.empty()) {
    const std::string trouble = doctor::check_service(line.node.middleware, run, line.service, line.seconds);
    if (!trouble.empty()) throw Error(trouble);
    return 0;
  }
  const doctor::Findings findings = doctor::examine(line.node.middleware, run, line.seconds);
  std::cout << (line.json ? doctor::as_json(findings) : doctor::as_text(findings)) << std::flush;
  return findings.problems.empty() ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Tells who is heard in a DDS domain and what is in the way. Exit status 0: all is well.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return examine(line); });
}
