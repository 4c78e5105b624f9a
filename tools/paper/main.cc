// SPDX-License-Identifier: Apache-2.0
// citylearn paper: repeats the paper's experiments on the given data and reports them.
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <ctime>
#include <fstream>
#include <iostream>
#include <optional>
#include <thread>

#include "core/files/files.h"
#include "core/plugin/plugins.h"
#include "core/util/error.h"
#include "core/util/version.h"
#include "core/util/wall_clock.h"
#include "core/wire/service.h"
#include "encoder_service/encoder_options.h"
#include "policy_service/run/sweep.h"
#include "tools/lab/programs.h"
#include "tools/paper/sections/sections.h"

namespace {

using namespace citylearn;
using namespace citylearn::paper;

struct CommandLine {
  WorldOptions world;
  std::string seeds, output = "runs/paper", store = "runs/store", work;
  std::vector<std::string> only;
  bool quick = false, list = false;
  double effort = 1;
  std::string text;  ///< the command as typed, without --only
};

void add_options(CLI::App& app, CommandLine& line) {
  const std::string data = "Recordings";
  app.option_defaults()->group(data);
  add_dataset_options(app, line.world.source, data);
  app.add_option("--train", line.world.source.traversal, "Traversal to learn from")->capture_default_str();
  add_selection_options(app, line.world.source.selection, data);
  app.add_option("--encoder", line.world.encoder,
                 "Encoder of the pictures: " + encoder_names() + " (" + kDefaultEncoder + ")");
  app.add_option("--model", line.world.files.model, "Network file for encoders that need one")->type_name("FILE");
  app.add_option("--store", line.store, "Folder of the feature store")
      ->type_name("DIR")
      ->envname("CITYLEARN_STORE")
      ->capture_default_str();
  app.option_defaults()->group("Report");
  app.add_flag("--quick", line.quick, "Fewer seeds and tasks: 15 minutes on two processors");
  app.add_option("--effort", line.effort,
                 "Share of training steps and tasks; below 1 the report fills quickly, with meaningless figures")
      ->capture_default_str()
      ->check(CLI::Range(0.001, 1.0));
  app.add_option("--seeds", line.seeds, "Seeds, such as 1..5 or 1,3 (1..5; --quick: 1..2)");
  std::vector<std::string> names;
  for (const Section& section : sections()) names.push_back(section.name);
  app.add_option("--only", line.only, "Make only these parts of the report: " + CLI::detail::join(names, ","))
      ->delimiter(',')
      ->check(CLI::IsMember(names));
  app.add_flag("--list", line.list, "Print the parts of the report, and exit")->configurable(false);
  app.add_option(
         "--output", line.output,
         "Folder of report.html, its figures and tables (SVG, PNG, CSV), results.json (outcomes that the same seeds "
         "reproduce), report.json (the rest that the page shows) and manifest.json (command, machine, data, files)")
      ->type_name("DIR")
      ->capture_default_str();
  app.add_option(
         "--work", line.work,
         "Folder of finished work, from which the next run continues; reports on different data may share it, even "
         "at the same time (OUTPUT/work)")
      ->type_name("DIR");
}

/// Returns the agents compared: the paper's, and the one that this project recommends.
std::vector<Agent> agents_of(World& world, const std::vector<std::uint64_t>& seeds, bool quick) {
  const std::string features = world.representations({64}).front();
  const std::vector<std::uint64_t> few = quick ? std::vector{seeds.front()} : seeds;
  std::vector<Agent> agents = {{"baseline", features, seeds, 40}, {"features", features, few, 90}};
  if (world.pictures()) agents.push_back({"raw_images", "raw84", few, 150});
  agents.push_back({"place_filter", features, seeds, 6});
  return agents;
}

/// Returns the options of a drawn world, for sections that need pictures or a map where the given data have none.
WorldOptions drawn_city(const CommandLine& line) {
  WorldOptions options;
  options.most_frames = line.quick ? 256 : 512;
  options.store = line.world.store;
  return options;
}

Json machine() {
  std::string model = "unknown", line;
  for (std::ifstream file("/proc/cpuinfo"); std::getline(file, line);)
    if (const std::size_t colon = line.find(": "); line.starts_with("model name") && colon != line.npos) {
      model = line.substr(colon + 2);
      break;
    }
  return {{"processors", std::thread::hardware_concurrency()},
          {"model", model},
          {"memory", static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE))},
          {"instructions", Eigen::SimdInstructionSetsInUse()}};
}

Json data_of(World& world) {
  Json traversals = Json::object();
  for (const std::string& name : world.names()) {
    const Traversal& traversal = world.recording(name);
    traversals[name] = {{"condition", traversal.condition},
                        {"frames", traversal.frames},
                        {"features", traversal.dimension},
                        {"hash", world.hashes({name})[name]}};
  }
  return {{"dataset", world.dataset()}, {"drawn", world.drawn()}, {"train", world.train()}, {"traversals", traversals}};
}

/// Returns manifest.json: what one needs to know to make the report again. "begun" and "seconds" are of the run that
/// wrote it; "work" holds what each unit took whenever it was done. The program that makes the page adds "files", the
/// SHA-256 of all files of the report.
Json manifest_of(const Context& context, const std::string& command, std::time_t begun, double seconds) {
  Json data = Json::array({data_of(context.world)});
  if (&context.drawn != &context.world) data.push_back(data_of(context.drawn));
  return {{"program", "citylearn_paper " + version()},
          {"compiler", __VERSION__},
          {"plugins", loaded_plugins()},
          {"machine", machine()},
          {"command", command},
          {"begun", date_of(begun)},
          {"seconds", seconds},
          {"quick", context.quick},
          {"effort", context.effort},
          {"seeds", context.seeds},
          {"frames", context.frames},
          {"data", data},
          {"work", context.work.times()}};
}

int make_report(CommandLine& line) {
  const std::time_t begun = std::time(nullptr);
  const Clock::time_point start = Clock::now();
  line.world.store = line.store == "none" ? "" : line.store;
  line.world.most_frames = line.quick ? 640 : 4000;
  const std::vector<std::uint64_t> seeds = parse_seeds(!line.seeds.empty() ? line.seeds : line.quick ? "1..2" : "1..5");
  World world(line.world);
  std::optional<World> city;
  if (!world.drawn() || !world.pictures()) city.emplace(drawn_city(line));
  create_folder(line.output, "choose another --output");
  Work work(line.work.empty() ? line.output + "/work" : line.work);
  const Context context{.world = world,
                        .drawn = city ? *city : world,
                        .work = work,
                        .quick = line.quick,
                        .effort = line.effort,
                        .seeds = seeds,
                        .frames = std::min(128, world.frames()),
                        .agents = agents_of(world, seeds, line.quick)};
  std::vector<Section> wanted;
  for (const Section& section : sections())
    if (line.only.empty() || std::find(line.only.begin(), line.only.end(), section.name) != line.only.end())
      wanted.push_back(section);
  Json parts = Json::array();
  for (const Section& section : wanted)
    parts.push_back({{"name", section.name}, {"title", section.title}, {"data", planned(section, context)}});
  const bool well = work.run();
  write_file(line.output + "/results.json", work.results());
  write_file(line.output + "/report.json", Json{{"command", line.text},
                                                {"version", version()},
                                                {"quick", line.quick},
                                                {"tasks", context.tasks()},
                                                {"recordings", world.description()},
                                                {"sections", parts},
                                                {"measurements", work.measurements()}}
                                                   .dump() +
                                               "\n");
  write_file(line.output + "/manifest.json",
             manifest_of(context, line.text, begun, seconds_since(start)).dump(2) + "\n");
  spdlog::info("drawing the figures");
  lab::run_python("paper/report", {line.output});
  std::cout << line.output << "/report.html" << std::endl;
  return well ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--only")
      ++i;
    else if (!word.starts_with("--only="))
      line.text += " " + word;
  }
  line.text = "citylearn paper" + line.text;
  return service_main(
      argc, argv, "Repeats the paper's experiments on the data at hand and writes a report.",
      [&](CLI::App& app) {
        add_plugin_option(app, argc, argv);
        add_options(app, line);
      },
      [&] {
        if (line.list) {
          for (const Section& section : sections()) std::cout << section.name << "  " << section.title << "\n";
          return 0;
        }
        try {
          return make_report(line);
        } catch (const Stopped&) {
          spdlog::warn("stopped; the same command goes on from here");
          return 130;
        }
      });
}
