// SPDX-License-Identifier: Apache-2.0
// See README.md.
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "bench/bench.h"
#include "bench/figures.h"
#include "bench/program.h"

namespace {

using namespace citylearn::testing;
using Arguments = std::vector<std::string>;

struct Options {
  std::string steps = "40000", middleware = "cyclonedds", agent = "features";
};

struct Figures {
  double rate = 0, update = 0, lag = 0, waited = 0;
};

/// `actors` 0: role both.
Figures train(const Options& options, int actors) {
  const Folder folder;
  std::vector<std::unique_ptr<Service>> services;
  const auto start = [&](Arguments command, const Arguments& more, const std::string& log) {
    command = citylearn::bench::on_wire(std::move(command), options.middleware, 151, "-" + std::to_string(actors));
    command.insert(command.end(), more.begin(), more.end());
    services.push_back(std::make_unique<Service>(command, folder / log));
  };
  const int environments = std::max(1, actors);
  const std::string count = std::to_string(environments);
  for (int i = 0; i < environments; ++i)
    start({CITYLEARN_ENV_SERVICE, "--agents", "16", "--synthetic-images", "0"}, {"--id", "env-" + std::to_string(i)},
          "env-" + std::to_string(i));
  for (int i = 0; i < actors; ++i)
    start({CITYLEARN_POLICY_SERVICE, "--role", "actor"}, {"--id", "actor-" + std::to_string(i)},
          "actor-" + std::to_string(i));
  start({CITYLEARN_POLICY_SERVICE, "--role", actors > 0 ? "learner" : "both"},
        {"--agent", options.agent, "--trainer-agents", "16", "--steps", options.steps, "--environments", count,
         "--tasks", "1", "--evaluate", "summer", "--wait", "30", "--output", folder / "out"},
        "learner");
  citylearn::bench::finish(*services.back(), "training");
  const auto summary = nlohmann::json::parse(contents(folder / "out/summary.json"))["train"];
  return {citylearn::bench::training_rate(folder / "out/metrics.csv"),
          summary["update_s"].get<double>() / summary["wall_s"].get<double>(), summary["policy_lag"],
          summary["actors_waited_s"]};
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app("A learner with actors beside one policy_service that is both", "bench_roles");
  app.add_option("steps", options.steps, "environment steps")->capture_default_str();
  app.add_option("middleware", options.middleware, "cyclonedds or fastdds")->capture_default_str();
  app.add_option("agent", options.agent, "network")->capture_default_str();
  return citylearn::bench::run(app, argc, argv, [&] {
    std::printf("%s, %s steps, %s, %u cores\n", options.agent.c_str(), options.steps.c_str(),
                options.middleware.c_str(), std::thread::hardware_concurrency());
    std::printf("%-10s %9s %10s %8s %14s %18s\n", "actors", "steps/s", "of both", "update", "lag, updates",
                "actors waited, s");
    const Figures both = train(options, 0);
    std::printf("%-10s %9.0f %10.2f %6.0f %% %14s %18s\n", "(both)", both.rate, 1.0, 100 * both.update, "0", "");
    citylearn::bench::record_figure({.name = "role both", .value = both.rate, .unit = "steps/s"});
    for (const int actors : {1, 2, 4}) {
      std::fflush(stdout);
      const Figures f = train(options, actors);
      std::printf("%-10d %9.0f %10.2f %6.0f %% %14.2f %18.1f\n", actors, f.rate, f.rate / both.rate, 100 * f.update,
                  f.lag, f.waited);
      citylearn::bench::record_figure(
          {.name = "actors: " + std::to_string(actors), .value = f.rate, .unit = "steps/s"});
    }
  });
}
