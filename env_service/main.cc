#include <CLI/CLI.hpp>
#include <iostream>
#include <map>

#include "core/service.h"
#include "env_service/dataset.h"
#include "env_service/env_service.h"

namespace {

using namespace citylearn;

struct CommandLine {
  EnvServiceOptions service;
  std::string dataset = "synthetic";
  std::string folder;
  std::string traversal = "summer";
  std::map<std::string, std::map<std::string, double>> parameters;  // those given, by dataset
  bool list = false;
  bool list_traversals = false;
};

void add_options(CLI::App& app, CommandLine& line) {
  const std::string group = "Environment";
  std::string names;
  for (const auto* entry : DatasetRegistry::instance().entries()) names += (names.empty() ? "" : ", ") + entry->name;
  app.add_option("--dataset", line.dataset, "Where traversals come from: " + names)
      ->capture_default_str()
      ->group(group);
  app.add_option("--data", line.folder, "Folder of the dataset's files")->type_name("DIR")->group(group);
  app.add_option("--traversal", line.traversal, "Traversal to host")->capture_default_str()->group(group);
  app.add_option("--agents", line.service.agents, "Agents on it")
      ->capture_default_str()
      ->check(CLI::Range(1, static_cast<int>(msg::MAX_AGENTS)))
      ->group(group);
  app.add_flag("--list", line.list, "Print datasets and middlewares, and exit")->configurable(false)->group(group);
  app.add_flag("--list-traversals", line.list_traversals, "Print the dataset's traversals, and exit")
      ->configurable(false)
      ->group(group);
  for (const auto* entry : DatasetRegistry::instance().entries())
    add_parameters(app, entry->name, entry->parameters, line.parameters[entry->name]);
  line.service.node.service = "env_service";
  add_node_options(app, line.service.node);
}

void list() {
  std::cout << "datasets (--dataset):\n";
  for (const auto* entry : DatasetRegistry::instance().entries())
    std::cout << describe(entry->name, entry->help, entry->parameters, entry->name);
  std::cout << "middlewares (--middleware):\n";
  for (const auto& [name, help] : list_middlewares()) std::cout << describe(name, help, {}, "");
}

int serve(CommandLine& line) {
  if (line.list) {
    list();
    return 0;
  }
  const auto& entry = DatasetRegistry::instance().find("dataset", line.dataset);
  for (const auto& [name, given] : line.parameters)
    if (name != line.dataset && !given.empty())
      throw Error("is for dataset " + name + ", but the dataset is " + line.dataset,
                  "--" + name + "-" + given.begin()->first);
  const std::unique_ptr<Dataset> dataset =
      entry.create(Parameters("dataset " + entry.name, entry.parameters, line.parameters[entry.name]), line.folder);
  if (line.list_traversals) {
    for (const std::string& name : dataset->names()) std::cout << name << "\n";
    return 0;
  }
  const Traversal traversal = dataset->load(line.traversal);
  run_env_service(line.service, traversal, stop_requested);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Hosts agents on one traversal of a route and lets a policy_service drive them, over DDS.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return serve(line); });
}
