// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <optional>
#include <sstream>

#include "core/util/progress.h"
#include "core/util/text.h"
#include "core/wire/service.h"
#include "tools/data/inspection.h"

namespace {

using namespace citylearn;

struct CommandLine {
  CLI::App *list = nullptr, *check = nullptr, *info = nullptr;
  std::string folder, dataset;
  bool json = false;
};

void add_options(CLI::App& app, CommandLine& line) {
  app.require_subcommand(1);
  line.list = app.add_subcommand("list", "List every dataset: its paper, where to get it, licence, size");
  line.check =
      app.add_subcommand("check", "Recognise the dataset of a folder and decode every frame; status 1 when one is bad");
  line.info = app.add_subcommand("info", "Print a table of a folder's traversals");
  for (CLI::App* command : {line.check, line.info}) {
    command->add_option("DIR", line.folder, "Folder of the dataset")->required();
    command->add_option("--dataset", line.dataset, "Read it as this dataset, without recognising it");
  }
  for (CLI::App* command : {line.list, line.check, line.info}) command->add_flag("--json", line.json, "Print JSON");
}

void list() {
  for (const auto* entry : DatasetRegistry::instance().entries()) {
    std::cout << entry->name << "\n  " << entry->help << "\n";
    for (const auto& [key, value] : entry->about) std::cout << "  " << key << ": " << value << "\n";
  }
}

/// Returns the dataset to read the folder as.
std::string dataset_of(const CommandLine& line) {
  if (!line.dataset.empty()) return line.dataset;
  const std::vector<std::string> found = recognised(line.folder);
  if (found.empty()) {
    // "plain" accepts nearly anything, so what it lacks is the most useful message.
    const std::vector<std::string> names = opened("plain", line.folder)->names();
    throw Error("is not recognised as a dataset", line.folder,
                "'citylearn_data list' shows them; --dataset NAME says what is missing");
  }
  std::cerr << line.folder << ": recognised as " << found.front();
  for (std::size_t i = 1; i < found.size(); ++i) std::cerr << (i == 1 ? " (also as " : ", ") << found[i];
  std::cerr << (found.size() > 1 ? ")" : "") << "\n";
  return found.front();
}

int check(const CommandLine& line) {
  const std::string name = dataset_of(line);
  std::optional<Progress> progress;
  const Inspection inspection = inspect(*opened(name, line.folder), [&](long done, long all) {
    if (done == 1) progress.emplace("frames", static_cast<int>(all));
    progress->done(1);
    return !stop_requested();
  });
  if (line.json) {
    std::cout << to_json(name, inspection) << "\n";
  } else {
    for (const Fault& fault : inspection.faults)
      std::cout << one_line(fault.traversal +
                            (fault.frame < 0 ? "" : ", frame " + std::to_string(fault.frame) + ", " + fault.name) +
                            ": " + fault.what)
                << "\n";
    std::cout << name << ": " << inspection.frames << " frames, " << inspection.faults.size() << " bad\n";
  }
  if (stop_requested()) throw Error("stopped before the end", line.folder);
  return inspection.faults.empty() ? 0 : 1;
}

std::string fixed(double value, int digits) {
  if (!std::isfinite(value)) return "-";
  std::ostringstream text;
  text << std::fixed << std::setprecision(digits) << value;
  return text.str();
}

int info(const CommandLine& line) {
  const std::string dataset_name = dataset_of(line);
  const std::unique_ptr<Dataset> dataset = opened(dataset_name, line.folder);
  std::vector<Summary> summaries;
  for (const std::string& name : dataset->names()) summaries.push_back(summarise(*dataset, name));
  const bool broken =
      std::any_of(summaries.begin(), summaries.end(), [](const Summary& one) { return !one.error.empty(); });
  if (line.json) {
    std::cout << to_json(dataset_name, summaries) << "\n";
    return broken;
  }
  std::cout << std::left << std::setw(26) << "traversal" << std::setw(14) << "condition" << std::right << std::setw(8)
            << "frames" << std::setw(10) << "metres" << std::setw(8) << "step m" << std::setw(5) << "GPS"
            << std::setw(12) << "pixels" << std::setw(9) << "features" << std::setw(5) << "bad"
            << "\n";
  for (const Summary& one : summaries) {
    std::cout << std::left << std::setw(26) << one_line(one.name);
    if (!one.error.empty()) {
      std::cout << "cannot be loaded: " << one.error << "\n";
      continue;
    }
    std::cout << std::setw(14) << one.condition << std::right << std::setw(8) << one.frames << std::setw(10)
              << fixed(one.metres, 0) << std::setw(8) << fixed(one.mean_step, 2) << std::setw(5)
              << (one.gps ? "yes" : "no") << std::setw(12)
              << (one.width ? std::to_string(one.width) + "x" + std::to_string(one.height) : "-") << std::setw(9)
              << (one.dimension ? std::to_string(one.dimension) : "-") << std::setw(5) << one.bad_frames << "\n";
  }
  return broken;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Lists the datasets, and checks and describes a folder of one.",
      [&](CLI::App& app) { add_options(app, line); },
      [&] {
        if (line.check->parsed()) return check(line);
        if (line.info->parsed()) return info(line);
        if (line.json)
          std::cout << datasets_json() << "\n";
        else
          list();
        return 0;
      });
}
