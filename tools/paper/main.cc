// SPDX-License-Identifier: Apache-2.0
// ./run paper: the paper's figures and tables on the data at hand, in one report.
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <ctime>
#include <iostream>
#include <optional>

#include "core/util/error.h"
#include "core/util/files.h"
#include "core/wire/service.h"
#include "encoder_service/encoder_options.h"
#include "policy_service/run/sweep.h"
#include "tools/paper/manifest.h"
#include "tools/paper/section.h"
#include "tools/paper/trials.h"

namespace {

using namespace citylearn;
using namespace citylearn::paper;

struct CommandLine {
  WorldOptions world;
  std::string seeds, output = "runs/paper", store = "runs/store", work;
  std::vector<std::string> only;
  bool quick = false, list = false, no_strips = false;
  double effort = 1;
  std::string text;  ///< as typed, without --only
};

std::vector<std::unique_ptr<Section>> sections() {
  std::vector<std::unique_ptr<Section>> all;
  all.push_back(make_compute());
  all.push_back(make_recognition());
  all.push_back(make_curves());
  all.push_back(make_deployment());
  all.push_back(make_pictures());
  all.push_back(make_datasets());
  all.push_back(make_longer());
  all.push_back(make_transfer());
  all.push_back(make_viewpoint());
  all.push_back(make_map());
  return all;
}

void add_options(CLI::App& app, CommandLine& line) {
  const std::string data = "Recordings", report = "Report";
  add_dataset_options(app, line.world.source, data);
  app.add_option("--train", line.world.source.traversal, "Traversal that is learned from")
      ->capture_default_str()
      ->group(data);
  add_selection_options(app, line.world.source.selection, data);
  app.add_option("--encoder", line.world.encoders,
                 "Encoders of pictures, of " + encoder_names() + " (hog,vlad; --quick: hog)")
      ->delimiter(',')
      ->group(data);
  app.add_option("--model", line.world.files.model, "Network of the encoders that need one")
      ->type_name("FILE")
      ->group(data);
  app.add_option("--store", line.store, "Folder that keeps what was encoded")
      ->type_name("DIR")
      ->envname("CITYLEARN_STORE")
      ->capture_default_str()
      ->group(data);
  app.add_flag("--quick", line.quick, "Fewer seeds, tasks and encoders: 15 minutes on two processors")->group(report);
  app.add_option(
         "--effort", line.effort,
         "Share of training steps and tasks: less than 1 fills the report quickly, with figures that tell nothing")
      ->capture_default_str()
      ->check(CLI::Range(0.001, 1.0))
      ->group(report);
  app.add_option("--seeds", line.seeds, "As 1..5 (1..5; --quick: 1..2)")->group(report);
  std::vector<std::string> names;
  for (const auto& section : sections()) names.push_back(section->name());
  app.add_option("--only", line.only, "These parts of the report: " + CLI::detail::join(names, ","))
      ->delimiter(',')
      ->check(CLI::IsMember(names))
      ->group(report);
  app.add_flag("--no-strips", line.no_strips,
               "Leave out real recordings' pictures, for a report that may be passed on where they may not")
      ->group(report);
  app.add_flag("--list", line.list, "Print the parts of the report, and exit")->configurable(false)->group(report);
  app.add_option(
         "--output", line.output,
         "Folder of report.html, its figures and tables (SVG, PNG, CSV), manifest.json (how, on what, with what "
         "files), results.json (all that is the same again with the same seeds: no seconds, for diff)")
      ->type_name("DIR")
      ->capture_default_str()
      ->group(report);
  app.add_option("--work", line.work,
                 "Folder of the work that is done, for the next run to go on from; reports on several data may share "
                 "it, also at the same time (OUTPUT/work)")
      ->type_name("DIR")
      ->group(report);
}

/// Who is compared: the paper's agents, and the one that this project recommends.
std::vector<Context::Agent> agents_of(World& world, const std::vector<std::uint64_t>& seeds, bool quick) {
  const std::vector<std::string> known = world.representations({64});
  const std::string features = known.front();
  const std::vector<std::uint64_t> few = quick ? first_of(seeds, 1) : seeds;
  std::vector<Context::Agent> agents = {{"baseline", "baseline (sees its position)", features, seeds, 40},
                                        {"features", "features (the paper's)", features, few, 90}};
  if (world.pictures()) agents.push_back({"raw_images", "raw images", "raw84", few, 150});
  agents.push_back({"place_filter", "place_filter (ours)", features, seeds, 6});
  return agents;
}

/// For sections that need pictures or a map where the data given have none.
WorldOptions drawn_city(const CommandLine& line) {
  WorldOptions options;
  options.encoders = {"hog"};
  options.most_frames = line.quick ? 256 : 512;
  options.store = line.world.store;
  return options;
}

int make_report(CommandLine& line) {
  const std::time_t begun = std::time(nullptr);
  const Clock::time_point start = Clock::now();
  line.world.usual = line.quick ? std::vector<std::string>{"hog"} : std::vector<std::string>{"hog", "vlad"};
  line.world.store = line.store == "none" ? "" : line.store;
  line.world.most_frames = line.quick ? 640 : 4000;
  const std::vector<std::uint64_t> seeds = parse_seeds(!line.seeds.empty() ? line.seeds : line.quick ? "1..2" : "1..5");
  World world(line.world);
  std::optional<World> city;
  if (!world.drawn() || !world.pictures()) city.emplace(drawn_city(line));
  make_folder(line.output, "--output");
  Work work(line.work.empty() ? line.output + "/work" : line.work);
  Context context{world,
                  city ? *city : world,
                  work,
                  line.quick,
                  line.effort,
                  seeds,
                  std::min(128, world.frames()),
                  line.text,
                  agents_of(world, seeds, line.quick)};
  context.strips = !line.no_strips;
  std::vector<std::unique_ptr<Section>> wanted;
  for (auto& section : sections())
    if (line.only.empty() || std::find(line.only.begin(), line.only.end(), section->name()) != line.only.end())
      wanted.push_back(std::move(section));
  for (const auto& section : wanted) section->plan(context);
  bool well = work.run();
  Report report(line.output);
  for (const auto& section : wanted) {
    report.section(section->name(), section->title());
    try {
      section->tell(context, report);
    } catch (const Error& error) {
      report.remark("The rest of this part could not be made: " + std::string(error.what()));
      spdlog::error("{}: {}", section->name(), error.what());
      well = false;
    }
  }
  report.write("CityLearn's experiments, again", "Made by: " + line.text + ", version " + version() + ", " +
                                                     (world.drawn() ? "on drawn recordings" : "on real recordings") +
                                                     ".");
  if (!report.draws())
    spdlog::info("the charts are not there as PNG: rsvg-convert draws them (apt-get install librsvg2-bin)");
  report.file("results.json", work.results());
  write_file(line.output + "/manifest.json",
             manifest_of(context, report, begun, std::chrono::duration<double>(Clock::now() - start).count()));
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
  line.text = "./run paper" + line.text;
  return service_main(
      argc, argv, "Repeats the paper's experiments on the data at hand and writes a report.",
      [&](CLI::App& app) { add_options(app, line); },
      [&] {
        if (line.list) {
          for (const auto& section : sections()) std::cout << section->name() << "  " << section->title() << "\n";
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
