// SPDX-License-Identifier: Apache-2.0
// Small benchmarks: bench_cases NAME [OPTIONS]. NAME.md states each one's question.
#include <cstdio>

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
  for (const Case& one : {Case{"beliefs", "What acting costs with whole and with sparse beliefs", beliefs},
                          {"loop", "Training over DDS beside training in one process", loop},
                          {"roles", "A learner with actors beside one policy_service that is both", roles},
                          {"security", "A secured training beside one that is not", security},
                          {"services", "Training with many env_services of one agent beside one of many", services}}) {
    CLI::App* command = app.add_subcommand(one.name, one.help);
    command->option_defaults()->always_capture_default();
    command->callback([&chosen, measure = one.add(*command)] { chosen = measure; });
  }
  try {
    app.parse(argc, argv);
    chosen();
    return 0;
  } catch (const CLI::ParseError& error) {
    return app.exit(error);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", app.get_name().c_str(), error.what());
    return 1;
  }
}
