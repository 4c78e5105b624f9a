// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>

#include "core/files/files.h"
#include "core/wire/service.h"
#include "tools/import/dashboard_sink.h"
#include "tools/import/event_files.h"
#include "tools/import/wandb_file.h"

namespace {

using namespace citylearn;
namespace fs = std::filesystem;

struct CommandLine {
  std::vector<std::string> paths;
  std::string store = "runs/dashboard.sqlite";
  std::string dashboard, token_file, project;
};

void add_options(CLI::App& app, CommandLine& line) {
  app.add_option("PATH", line.paths, "TensorBoard event files, W&B offline runs (run-ID.wandb), or folders of them")
      ->required();
  CLI::Option* store =
      app.add_option("--store", line.store, "Database file of a dashboard that does not run; created if missing")
          ->capture_default_str();
  app.add_option("--dashboard", line.dashboard, "Send them to a dashboard that runs: http://HOST:PORT")
      ->excludes(store);
  app.add_option("--token-file", line.token_file, "File with that dashboard's token");
  app.add_option("--project", line.project, "Project of the runs (default: tensorboard; of W&B, the runs' own)");
}

/// What there is to import.
struct Found {
  std::map<std::string, std::vector<std::string>> event_folders;  ///< event files in the order of their names
  std::vector<std::string> wandb_files;
  fs::path root;
};

/// Returns the name of a run whose event files are in `folder`: its path below what the user named.
std::string run_name(const fs::path& folder, const fs::path& root) {
  const fs::path relative = fs::weakly_canonical(folder).lexically_relative(fs::weakly_canonical(root));
  return relative.empty() || relative == "." ? fs::weakly_canonical(folder).filename().string() : relative.string();
}

Found find(const std::string& path) {
  Found found;
  found.root = fs::is_directory(path) ? fs::path(path) : fs::path(path).parent_path();
  const auto take = [&](const fs::path& file) {
    const std::string name = file.filename();
    if (is_wandb_file(name)) found.wandb_files.push_back(file);
    if (is_event_file(name)) found.event_folders[file.parent_path()].push_back(file);
  };
  if (!fs::exists(path)) throw Error("does not exist", path);
  if (fs::is_directory(path)) {
    for (const auto& entry : fs::recursive_directory_iterator(path))
      if (entry.is_regular_file()) take(entry.path());
  } else {
    take(path);
  }
  for (auto& [folder, files] : found.event_folders) std::sort(files.begin(), files.end());
  std::sort(found.wandb_files.begin(), found.wandb_files.end());
  if (found.event_folders.empty() && found.wandb_files.empty())
    throw Error("has neither event files of TensorBoard nor run-ID.wandb files", path);
  return found;
}

std::string token_of(const std::string& file) {
  if (file.empty()) return "";
  std::string token = read_file(file, 4096);
  token.erase(token.find_last_not_of(" \r\n") + 1);
  return token;
}

/// Prints what came of a run. Returns whether all of it was imported.
bool report(const ImportedRun& run) {
  std::cout << run.id << ": " << run.points << " points\n";
  if (!run.problem.empty()) std::cerr << run.problem << "\n";
  return run.problem.empty();
}

int import(const CommandLine& line) {
  std::unique_ptr<DashboardSink> dashboard;
  std::unique_ptr<Store> store;
  std::unique_ptr<LoggedRuns> runs;
  LogSink sink;
  std::vector<Found> all;
  for (const std::string& path : line.paths) all.push_back(find(path));
  if (!line.dashboard.empty()) {
    dashboard = std::make_unique<DashboardSink>(line.dashboard, token_of(line.token_file));
    sink = [&](const std::string& id, const LogBatch& batch) { return dashboard->append(id, batch); };
  } else {
    const auto folder = fs::path(line.store).parent_path();
    if (!folder.empty()) create_folder(folder);
    store = std::make_unique<Store>(Store::Options{line.store, 0});
    runs = std::make_unique<LoggedRuns>(*store);
    sink = [&](const std::string& id, const LogBatch& batch) { return runs->append(id, batch); };
  }
  bool whole = true;
  for (const Found& found : all) {
    for (const auto& [folder, files] : found.event_folders) {
      const std::string project = line.project.empty() ? "tensorboard" : line.project;
      whole &= report(import_event_files(files, logged_id(project, run_name(folder, found.root)), sink));
    }
    for (const std::string& file : found.wandb_files) whole &= report(import_wandb_file(file, line.project, sink));
  }
  return whole ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Imports runs that TensorBoard or Weights & Biases recorded into the dashboard.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return import(line); });
}
