// SPDX-License-Identifier: Apache-2.0
#include <malloc.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <opencv2/core.hpp>

#include "core/plugin/plugins.h"
#include "core/wire/service.h"
#include "encoder_service/encoder_options.h"
#include "encoder_service/encoder_service.h"
#include "encoder_service/pipeline/learned_files.h"

namespace {

using namespace citylearn;

struct CommandLine {
  EncoderServiceOptions service;
  std::map<std::string, std::map<std::string, double>> parameters;  // as given, by encoder
  ReductionChoice reduction;
  std::string on_bad_frame = "refuse";
  int threads = 0;
  bool list = false;
};

void add_options(CLI::App& app, CommandLine& line) {
  const std::string encoding = "Encoding";
  EncoderServiceOptions& service = line.service;
  app.option_defaults()->group(encoding);
  app.add_option("--encoder", service.encoder, "One of " + encoder_names())->capture_default_str();
  add_encoder_options(app, service.files, line.parameters, encoding);
  app.add_option("--threads", line.threads, "Threads that decode and encode pictures; 0 uses all processors")
      ->capture_default_str()
      ->check(CLI::Range(0, 1024));
  app.add_option("--on-bad-frame", line.on_bad_frame,
                 "What to do with broken pictures: refuse their traversal, or skip them and use a neighbour's features")
      ->capture_default_str()
      ->check(CLI::IsMember({"refuse", "skip"}));
  app.add_option(
         "--store", service.store,
         "Folder that stores what was encoded and learned; 'none' keeps it in memory. Several encoder_services need "
         "no common one")
      ->type_name("DIR")
      ->envname("CITYLEARN_STORE")
      ->capture_default_str();
  app.add_flag("--list", line.list, "Print encoders and middlewares, then exit")->configurable(false);

  app.option_defaults()->group("Reduction");
  add_reduction_options(app, line.reduction, "Reduction");
  app.add_option("--reduction", service.reduction_file,
                 "Reduction learned earlier, instead of one learned on --reference")
      ->type_name("FILE");
  service.node.service = "encoder_service";
  service.node.id = "encoder";
  add_node_options(app, service.node);
  add_metrics_option(app, service.node);
  add_memory_option(app);
}

void list() {
  std::cout << list_encoders() << "middlewares (--middleware):\n";
  for (const auto& [name, help] : list_middlewares()) std::cout << describe(name, help, {}, "");
}

int serve(CommandLine& line) {
  // Pictures and their copies come and go with each batch. Memory that went back to the system each time would cost a
  // third of encoding: the system fills it with zeros, page by page.
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 64 << 20);
  ChosenEncoder chosen = choose_encoder(line.service.encoder, line.service.files);
  line.service.encoder = chosen.entry.name;
  line.service.files = std::move(chosen.files);
  for (const auto& [name, given] : line.parameters)
    if (name != line.service.encoder && !given.empty())
      throw Error("is for encoder " + name + ", but the encoder is " + line.service.encoder,
                  "--" + name + "-" + given.begin()->first);
  if (line.list) {
    list();
    return 0;
  }
  line.service.parameters = line.parameters[line.service.encoder];
  line.service.reference = line.reduction.reference;
  line.service.reduction = line.reduction.reduction;
  line.service.reduction.centring = centring_of(line.reduction.centring);
  if (line.service.reduction_file.empty()) line.service.reduction = reduction_for(line.service.encoder, line.reduction);
  line.service.cap_dimension = !line.reduction.dimension_given;
  line.service.skip_bad_frames = line.on_bad_frame == "skip";
  if (line.service.store == "none") line.service.store.clear();
  cv::setNumThreads(line.threads == 0 ? cv::getNumberOfCPUs() : line.threads);
  run_encoder_service(line.service, stop_requested);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  line.service.store = default_store();
  return service_main(
      argc, argv,
      "Encodes the pictures of env_services as features and completes their observations. Several with the same "
      "options divide the frames, so that each is encoded once.",
      [&](CLI::App& app) {
        add_plugin_option(app, argc, argv);
        add_options(app, line);
      },
      [&] { return serve(line); });
}
