// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <iostream>

#include "core/plugin/plugins.h"
#include "core/task/live.h"
#include "core/util/name.h"
#include "core/util/text.h"
#include "core/util/wall_clock.h"
#include "core/wire/messages.h"
#include "core/wire/service.h"
#include "env_service/dataset_io/dataset.h"
#include "env_service/dataset_io/selection.h"
#include "env_service/env_service.h"
#include "env_service/traversal/goal_place.h"

namespace {

using namespace citylearn;

struct CommandLine {
  EnvServiceOptions service;
  Source source;
  RobotOptions robot;  // of dataset live
  std::string robot_traversal = kLive;
  CLI::Option* agents = nullptr;
  std::vector<const CLI::Option*> of_robots;  // what is of no use without a robot
  bool list = false;
  bool list_traversals = false;
  bool show = false;
};

void add_options(CLI::App& app, CommandLine& line) {
  const std::string group = "Environment";
  const OptionGroup environment(app, group);
  add_source_options(app, line.source, group);
  add_goal_option(app, line.source);
  add_goals_option(app, line.service.goals);
  line.agents = app.add_option("--agents", line.service.agents, "Number of agents on the traversal")
                    ->capture_default_str()
                    ->check(CLI::Range(1, static_cast<int>(msg::MAX_AGENTS)));
  app.add_option("--evaluation-agents", line.service.evaluation_agents,
                 "Agents of an evaluation at most: one a task, and never fewer than --agents. More than --agents are "
                 "for this project's policy_service alone")
      ->capture_default_str()
      ->check(CLI::Range(1, static_cast<int>(msg::MAX_AGENTS)));
  app.add_option("--recorders", line.service.recorders,
                 "Ids of services that record episodes, A,B,...: their episodes are kept from the start, not only "
                 "once they are heard of")
      ->delimiter(',')
      ->type_name("ID")
      ->check(name_problem);
  app.add_option("--linger", line.service.linger,
                 "Seconds to wait at the end for live recorders to acknowledge the last episodes")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 3600.0));
  add_selection_options(app, line.source.selection, "Part of the traversal");
  add_imperfection_options(app, line.service.imperfections, "Imperfect world");
  const std::string live = "A robot (--dataset live)";
  add_robot_options(app, line.robot, live);
  const OptionGroup robot(app, live);
  app.add_option("--as", line.robot_traversal, "Name of what the robot sees, as that of a traversal")
      ->capture_default_str()
      ->check(name_problem);
  line.of_robots = std::as_const(app).get_options(
      [&](const CLI::Option* option) { return option->get_group() == live && option->get_envname().empty(); });
  app.add_flag("--list", line.list, "Print datasets and middlewares, then exit")->configurable(false);
  app.add_flag("--list-traversals", line.list_traversals, "Print the dataset's traversals, then exit")
      ->configurable(false);
  app.add_flag("--show", line.show,
               "Print dataset, announced name, frames, images and features of the traversal, whether on streets, and "
               "how the dataset matches traversals (index or otherwise), a line each, then exit; with "
               "--list-traversals of each, below a line 'recording NAME'")
      ->configurable(false);
  line.service.node.service = "env_service";
  add_node_options(app, line.service.node);
  add_metrics_option(app, line.service.node);
  add_memory_option(app);
}

void list() {
  std::cout << "datasets (--dataset):\n";
  for (const auto* entry : DatasetRegistry::instance().entries())
    std::cout << describe(entry->name, entry->help, entry->parameters, entry->name);
  std::cout << "middlewares (--middleware):\n";
  for (const auto& [name, help] : list_middlewares()) std::cout << describe(name, help, {}, "");
}

/// Makes a taught traversal one that a robot sees again.
void make_live(Traversal& taught, CommandLine& line) {
  if (taught.streets) throw Error("a robot drives along a line", "--rule", "give --rule line");
  if (!taught.images) throw Error("has features, not pictures", "traversal '" + taught.name + "'", "teach one");
  if (line.service.imperfections != Imperfections())
    throw Error("a robot is imperfect by itself", "--slip and the like", "leave them out");
  if (taught.goal >= 0 || line.service.goals > 1)
    throw Error("a robot is sent by the topic of --goal", taught.goal >= 0 ? "--goal-place" : "--goals",
                "leave it out");
  if (line.agents->empty()) line.service.agents = 1;
  line.service.evaluation_agents = 1;
  taught.name = taught.condition = line.robot_traversal;
  const auto images = std::make_shared<LiveImages>(taught.images, taught.name, microseconds_since_epoch());
  taught.images = images;
  line.service.live = LiveOptions{line.robot, images};
}

int serve(CommandLine& line) {
  if (line.list) {
    list();
    return 0;
  }
  const std::unique_ptr<Dataset> dataset = open_dataset(line.source);
  const auto load = [&](const std::string& name) {
    Traversal recorded = select(*dataset, name, line.source.selection);
    recorded = with_goals(with_goal(std::move(recorded), line.source.goal), line.service.goals);
    Traversal traversal = imperfect(std::move(recorded), line.service.imperfections);
    traversal.name = name_from(traversal.name);  // folders and files may be called anything
    return traversal;
  };
  const auto show = [&](const Traversal& traversal) {
    std::cout << "dataset " << traversal.dataset << "\ntraversal " << traversal.name << "\nframes " << traversal.frames
              << "\nimages " << (traversal.images ? "yes" : "no") << "\nfeatures " << traversal.dimension
              << (traversal.streets ? "\nstreets yes" : "") << "\nmatched by "
              << (dataset->correspondence() == Correspondence::kIndex ? "index" : "dataset") << "\n";
  };
  if (line.list_traversals) {
    int status = 0;
    const std::vector<std::string> names = dataset->names();
    if (names.empty()) throw unknown_traversal("", line.source.folder, names);
    for (const std::string& name : names) {
      std::cout << (line.show ? "recording " : "") << one_line(name) << std::endl;
      if (line.show) try {
          show(load(name));
        } catch (const Error& error) {
          spdlog::error("{}: {}", one_line(name), error.what());
          status = 1;
        }
    }
    return status;
  }
  Traversal traversal = load(chosen_traversal(*dataset, line.source));
  if (line.show) {
    show(traversal);
    return 0;
  }
  if (traversal.dataset == kLive) {
    make_live(traversal, line);
  } else {
    for (const CLI::Option* option : line.of_robots)
      if (option->count() > 0) throw Error("is of a robot", option->get_name(), "add --dataset live, or leave it out");
  }
  run_env_service(line.service, traversal, stop_requested);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Hosts agents on one traversal of a route, which a policy_service drives over DDS.",
      [&](CLI::App& app) {
        add_plugin_option(app, argc, argv);
        add_options(app, line);
      },
      [&] { return serve(line); });
}
