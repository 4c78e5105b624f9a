#include <CLI/CLI.hpp>
#include <iostream>

#include "core/service.h"
#include "env_service/dataset.h"
#include "env_service/env_service.h"

int main(int argc, char** argv) {
  using namespace citylearn;
  EnvServiceOptions options;
  options.node.service = "env_service";
  std::string dataset = "synthetic", data, traversal = "summer";
  std::map<std::string, std::map<std::string, double>> parameters;  // given, by dataset
  bool list = false, list_traversals = false;

  const auto setup = [&](CLI::App& app) {
    app.add_flag("--list", list, "Print datasets and middlewares with their parameters, and exit");
    app.add_flag("--list-traversals", list_traversals,
                 "Print the traversals of the chosen dataset, a line each, and exit");
    app.add_option("--dataset", dataset, "Where traversals come from")->capture_default_str();
    app.add_option("--data", data, "Folder of the dataset (not for synthetic)");
    app.add_option("--traversal", traversal, "Traversal hosted here")->capture_default_str();
    app.add_option("--agents", options.agents, "Agents hosted here")
        ->capture_default_str()
        ->check(CLI::Range(1u, msg::MAX_AGENTS));
    add_node_options(app, options.node);
    for (const auto* entry : DatasetRegistry::instance().entries())
      add_parameters(app, entry->name, entry->parameters, parameters[entry->name]);
  };

  const auto body = [&] {
    if (list) {
      std::cout << "Datasets (--dataset):\n";
      for (const auto* entry : DatasetRegistry::instance().entries())
        std::cout << describe(entry->name, entry->help, entry->parameters, entry->name);
      std::cout << "\nMiddlewares (--middleware):\n";
      for (const auto& [name, help] : list_middlewares()) std::cout << describe(name, help, {}, "");
      return 0;
    }
    const auto& entry = DatasetRegistry::instance().find("dataset", dataset);
    const auto source = entry.create(Parameters(dataset, entry.parameters, parameters[dataset]), data);
    if (list_traversals) {
      for (const std::string& name : source->names()) std::cout << name << "\n";
      return 0;
    }
    const Traversal loaded = source->load(traversal);
    run_env_service(options, loaded, stop_requested);
    return 0;
  };
  return service_main(argc, argv, "Hosts navigation agents on one traversal of a recorded route.", setup, body);
}
