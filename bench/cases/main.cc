// SPDX-License-Identifier: Apache-2.0
// Small benchmarks: bench_cases NAME [OPTIONS]. NAME.md states each one's question.
#include "bench/cases/cases.h"

int main(int argc, char** argv) {
  using namespace citylearn::bench;
  struct Case {
    const char *name, *help;
    Measure (*add)(CLI::App& command);
  };
  CLI::App app("Benchmarks that take little code", "bench_cases");
  app.require_subcommand(1);
  Measure chosen;
  for (const Case& one :
       {Case{"encoder", "What the encoder of ONNX networks costs beside OpenCV's forward pass", encoder},
        {"encoding", "What encoders cost beside decoding the pictures", encoding},
        {"images", "Training on pictures beside training on features, over DDS", images},
        {"live", "What live pictures and scenes cost the dashboard's server beside bare sockets", live},
        {"loop", "Training over DDS beside training in one process", loop},
        {"loss", "A training whose network loses packets beside one whose network does not", loss},
        {"places", "How time and memory of place_filter grow with the route", places},
        {"products", "The passes of a network beside plain matrix products", products},
        {"roles", "A learner with actors beside one policy_service that is both", roles},
        {"security", "A secured training beside one that is not", security},
        {"services", "Training with many env_services of one agent beside one of many", services},
        {"startup", "How long services take to start", startup},
        {"store", "What the dashboard's store costs beside a plain file", store},
        {"threads", "The updates of a learner on more threads and in more shards", threads},
        {"torch", "The updates of ppo and torch_ppo on the same rollouts", torch},
        {"training", "Training in one process, without the wire", training},
        {"updates", "The updates of a learner beside the matrix products in them", updates}}) {
    CLI::App* command = app.add_subcommand(one.name, one.help);
    command->option_defaults()->always_capture_default();
    command->callback([&chosen, measure = one.add(*command)] { chosen = measure; });
  }
  return run(app, argc, argv, [&] { chosen(); });
}
