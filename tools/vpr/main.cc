// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/chrono.h>

#include <CLI/CLI.hpp>
#include <ctime>
#include <iostream>

#include "core/plugin/plugins.h"
#include "core/wire/service.h"
#include "encoder_service/encoder_options.h"
#include "tools/vpr/evaluate.h"

namespace {

using namespace citylearn;

struct CommandLine {
  vpr::Options options;
  std::string measure = "cosine";
  std::string store = "none";
  bool list = false;
  bool no_pictures = false;
};

template <class List>
CLI::Option* add_list(CLI::App& app, const std::string& name, List& list, const std::string& help) {
  return app.add_option(name, list, help)->delimiter(',')->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
}

void add_encoding(CLI::App& app, vpr::Options& options, CommandLine& line) {
  const std::string group = "Encoding";
  app.option_defaults()->group(group);
  add_list(app, "--encoder", options.encoders,
           "Encoders: " + encoder_names() + " (" + kDefaultEncoder + "); not for datasets that have features");
  add_encoder_options(app, options.files, options.parameters, group);
  app.add_option("--store", line.store, "Folder of the feature store; none keeps features in memory only")
      ->type_name("DIR")
      ->envname("CITYLEARN_STORE")
      ->capture_default_str();
}

void add_matching(CLI::App& app, vpr::Options& options, CommandLine& line) {
  app.option_defaults()->group("Features")->always_capture_default();
  add_list(app, "--dimension", options.dimensions, "Features per frame, by PCA on the reference; 0 disables PCA")
      ->check(CLI::Range(0, kMaxDimension));
  add_list(app, "--centring", options.centrings, "Which mean to subtract first: own, running, reference, none")
      ->check(CLI::IsMember({"own", "running", "reference", "none"}));
  app.add_option("--whitening", options.whitening, "Whitening exponent: 0 disables it, 0.5 is full whitening")
      ->check(CLI::Range(0.0, 0.5));

  app.option_defaults()->group("Matching");
  lab::MatchingOptions& match = options.matching;
  add_list(app, "--method", options.methods,
           "nearest or mlp, then any of csls, contrast, sequence, past, seqslam, joined by +, such as csls+sequence");
  app.add_option("--measure", line.measure, "How features are compared: cosine, l1")
      ->check(CLI::IsMember({"cosine", "l1"}));
  app.add_option("--sequence", match.sequence, "Length of a sequence in frames, odd")->check(CLI::Range(1, 999));
  app.add_option("--past", match.past, "How many earlier frames past takes with each frame")->check(CLI::Range(1, 999));
  app.add_option("--slowest", match.slowest, "Slowest speed of sequence and past, in reference frames per query frame")
      ->check(CLI::Range(0.1, 10.0));
  app.add_option("--fastest", match.fastest, "Fastest speed of sequence, likewise")->check(CLI::Range(0.1, 10.0));
  app.add_option("--contrast-window", match.window, "Window of contrast and seqslam, in reference frames")
      ->check(CLI::Range(1, 100000));
  app.add_option("--csls-neighbours", match.neighbours, "Number of nearest frames that csls averages")
      ->check(CLI::Range(1, 100000));
  app.add_option("--mlp-hidden", match.hidden, "Hidden units of mlp")->check(CLI::Range(1, 4096));
  app.add_option("--mlp-epochs", match.epochs, "Training epochs of mlp on the reference")->check(CLI::Range(1, 100000));
  app.add_option("--seed", match.seed, "Random seed of mlp and of the intervals");
  app.option_defaults()->always_capture_default(false);
}

void add_options(CLI::App& app, CommandLine& line) {
  vpr::Options& options = line.options;
  const std::string recordings = "Recordings";
  app.option_defaults()->group(recordings);
  add_dataset_options(app, options.source, recordings);
  app.add_option("--reference", options.source.traversal, "Traversal whose frames are the places")
      ->capture_default_str();
  add_list(app, "--query", options.queries, "Traversals to recognise (all others)");
  add_selection_options(app, options.source.selection, "Selection");
  add_encoding(app, options, line);
  add_matching(app, options, line);

  app.option_defaults()->group("Results");
  app.add_option("--tolerance", options.tolerance, "How many frames a right answer may be off")
      ->capture_default_str()
      ->check(CLI::Range(0, 100000));
  app.add_option("--radius", options.radius,
                 "How many metres a right answer may be off, by latitude and longitude or, where those are not known, "
                 "along the route (replaces --tolerance, disables alignment)")
      ->type_name("METRES")
      ->check(CLI::Range(0.01, 1e6));
  app.add_option(
         "--output", options.output,
         "Folder for index.html and what it shows: results.csv, results.json, curves.json, pr-*.svg, matches-*.jpg, "
         "similarity-*.png (runs/vpr-TIME)")
      ->type_name("DIR");
  app.add_flag("--no-pictures", line.no_pictures, "Do not write matches-*.jpg and similarity-*.png");
  app.add_flag("--list", line.list, "Print encoders, and exit")->configurable(false);
}

int run(CommandLine& line) {
  if (line.list) {
    std::cout << list_encoders();
    return 0;
  }
  vpr::Options& options = line.options;
  if (options.matching.sequence % 2 == 0) throw Error("must be odd", "--sequence");
  if (options.matching.slowest > options.matching.fastest) throw Error("is more than --fastest", "--slowest");
  options.matching.measure = measure_of(line.measure);
  options.store = line.store == "none" ? "" : line.store;
  options.pictures = !line.no_pictures;
  options.matching.overview = options.pictures ? 1024 : 0;
  if (options.output.empty())
    options.output = fmt::format("runs/vpr-{:%Y%m%d-%H%M%S}", fmt::localtime(std::time(nullptr)));
  return vpr::evaluate(options);
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  for (int i = 0; i < argc; ++i) line.options.command += (i ? " " : "") + std::string(argv[i]);
  return service_main(
      argc, argv, "Evaluates place recognition: which frames of a query traversal show which place of a reference.",
      [&](CLI::App& app) {
        add_plugin_option(app, argc, argv);
        add_options(app, line);
      },
      [&] { return run(line); });
}
