// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <iostream>
#include <optional>

#include "core/command_line/progress.h"
#include "core/files/files.h"
#include "core/plugin/plugins.h"
#include "core/util/text.h"
#include "core/wire/service.h"
#include "env_service/dataset_io/selection.h"
#include "tools/data/inspection.h"

namespace {

using namespace citylearn;

struct CommandLine {
  CLI::App *list = nullptr, *check = nullptr, *info = nullptr;
  Source source;  ///< its dataset is empty until it is given or recognised
  std::string picture;
};

void add_options(CLI::App& app, CommandLine& line) {
  app.require_subcommand(1);
  line.list = app.add_subcommand("list", "List every dataset: its paper, where to get it, licence, size");
  line.check = app.add_subcommand(
      "check",
      "Recognise the dataset of a folder, decode every frame and list what is not taken; status 0 only when "
      "all is good and, of your own recordings, taken");
  line.info = app.add_subcommand("info", "Print a table of a folder's traversals");
  for (CLI::App* command : {line.check, line.info}) {
    command->add_option("DIR", line.source.folder, "Folder of the dataset")->required();
    command->add_option("--dataset", line.source.dataset,
                        "Read it as this dataset, without recognising it; an option of a dataset names it too");
    add_dataset_parameters(*command, line.source);
  }
  line.check->add_option("--picture", line.picture,
                         "Draw the routes, and which frames look alike, how surely, into this file (SVG)");
  for (CLI::App* command : {line.list, line.check, line.info}) command->fallthrough();  // --plugin may stand behind it
}

void list() {
  for (const auto* entry : DatasetRegistry::instance().entries()) {
    std::cout << entry->name << "\n  " << entry->help << "\n";
    for (const auto& [key, value] : entry->about) std::cout << "  " << key << ": " << value << "\n";
  }
}

/// Opens the folder as the dataset given, else as the one that it is recognised as. Throws Error when it has nothing.
std::unique_ptr<Dataset> open_source(Source& source) {
  const bool given = !source.dataset.empty();
  if (!given) source.dataset = dataset_of(source);
  std::unique_ptr<Dataset> dataset = open_dataset(source);
  if (dataset->names().empty()) throw unknown_traversal("", source.folder, {});
  if (!given) std::cerr << source.folder << ": recognised as " << source.dataset << "\n";
  return dataset;
}

int check(CommandLine& line) {
  const std::unique_ptr<Dataset> dataset = open_source(line.source);
  std::optional<Progress> progress;
  const Inspection inspection = inspect(*dataset, line.source.folder, [&](long done, long all) {
    if (done == 1) progress.emplace("frames", static_cast<int>(all));
    progress->done(1);
    return !stop_requested();
  });
  if (!line.picture.empty()) write_file(line.picture, to_svg(inspection));
  for (const Fault& fault : inspection.faults)
    std::cout << one_line(fault.traversal +
                          (fault.frame < 0 ? "" : ", frame " + std::to_string(fault.frame) + ", " + fault.name) + ": " +
                          fault.what)
              << "\n";
  for (const std::string& kind : inspection.not_taken) std::cout << one_line("not taken: " + kind) << "\n";
  for (const std::string& note : inspection.notes) std::cout << one_line(note) << "\n";
  for (const std::string& kind : inspection.left_out) std::cout << one_line("left out: " + kind) << "\n";
  std::cout << line.source.dataset << ": " << inspection.frames << " frames, " << inspection.faults.size() << " bad";
  if (!inspection.not_taken.empty()) std::cout << "; kinds of files not taken: " << inspection.not_taken.size();
  std::cout << "\n";
  if (stop_requested()) throw Error("stopped before the end", line.source.folder);
  return inspection.faults.empty() && inspection.not_taken.empty() ? 0 : 1;
}

int info(CommandLine& line) {
  const std::unique_ptr<Dataset> dataset = open_source(line.source);
  std::vector<Summary> summaries;
  for (const std::string& name : dataset->names()) summaries.push_back(summarise(*dataset, name));
  const bool broken =
      std::any_of(summaries.begin(), summaries.end(), [](const Summary& one) { return !one.error.empty(); });
  std::cout << to_table(summaries);
  return broken;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  line.source.dataset.clear();
  return service_main(
      argc, argv, "Lists the datasets, and checks and describes a folder of one.",
      [&](CLI::App& app) {
        add_plugin_option(app, argc, argv);
        add_options(app, line);
      },
      [&] {
        if (line.check->parsed()) return check(line);
        if (line.info->parsed()) return info(line);
        list();
        return 0;
      });
}
