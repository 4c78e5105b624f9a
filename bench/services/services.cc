// SPDX-License-Identifier: Apache-2.0
// See README.md.
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "bench/bench.h"
#include "bench/figures.h"
#include "bench/program.h"

namespace {

using namespace citylearn::testing;
using citylearn::bench::median;

struct Options {
  std::vector<std::string> agents = {"features", "place_filter"}, middlewares = {"cyclonedds", "fastdds"};
  std::vector<std::string> policy;  // of the policy_service
  int services = 16, rounds = 5, steps = 40000;
};

struct Figures {
  double rate = 0, inference = 0, update = 0;  // steps/s; shares of the time
};

/// Trains with env_services of as many agents each.
Figures train(const Options& options, const std::string& agent, const std::string& middleware, int services,
              int agents) {
  const Folder folder;
  const std::string count = std::to_string(services);
  const auto wired = [&](std::vector<std::string> command) {
    return citylearn::bench::on_wire(std::move(command), middleware, 152, "-" + count);
  };
  std::vector<std::unique_ptr<Service>> hosts;
  for (int i = 0; i < services; ++i) {
    const std::string id = "env-" + std::to_string(i);
    hosts.push_back(std::make_unique<Service>(
        wired({CITYLEARN_ENV_SERVICE, "--id", id, "--agents", std::to_string(agents), "--synthetic-images", "0"}),
        folder / (id + ".log")));
  }
  std::vector<std::string> policy = wired({CITYLEARN_POLICY_SERVICE, "--agent", agent, "--environments", count,
                                           "--steps", std::to_string(options.steps), "--tasks", "1", "--evaluate",
                                           "summer", "--wait", "30", "--output", folder / "out"});
  policy.insert(policy.end(), options.policy.begin(), options.policy.end());
  Service learner(policy, folder / "policy.log");
  citylearn::bench::finish(learner, "training");
  const auto summary = nlohmann::json::parse(contents(folder / "out/summary.json"))["train"];
  const double wall = summary["wall_s"];
  return {citylearn::bench::training_rate(folder / "out/metrics.csv"), summary["inference_s"].get<double>() / wall,
          summary["update_s"].get<double>() / wall};
}

void compare(const Options& options, const std::string& agent, const std::string& middleware) {
  std::map<int, std::vector<double>> rates, inference, update;  // by the number of env_services
  std::vector<double> ratios;
  for (int round = 0; round < options.rounds; ++round) {
    for (const int services : {1, options.services}) {
      const Figures figures = train(options, agent, middleware, services, options.services / services);
      rates[services].push_back(figures.rate);
      inference[services].push_back(figures.inference);
      update[services].push_back(figures.update);
    }
    ratios.push_back(rates[options.services].back() / rates[1].back());
  }
  for (const int services : {1, options.services}) {
    const double rate = median(rates[services]);
    std::printf("%-13s %-11s %3d x %-3d %9.0f %9.0f %% %6.0f %% %8.2f\n", agent.c_str(), middleware.c_str(), services,
                options.services / services, rate, 100 * median(inference[services]), 100 * median(update[services]),
                services == 1 ? 1.0 : median(ratios));
    citylearn::bench::record_figure(
        {.name = agent + ", " + middleware + ", " + std::to_string(services) + " env_services",
         .value = rate,
         .unit = "steps/s"});
  }
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app("Training with many env_services of one agent beside one of many", "bench_services");
  app.add_option("--agent", options.agents, "networks")->capture_default_str();
  app.add_option("--middleware", options.middlewares, "cyclonedds, fastdds")->capture_default_str();
  app.add_option("--services", options.services, "env_services; as many agents in all")
      ->check(CLI::Range(2, 64))
      ->capture_default_str();
  app.add_option("--steps", options.steps, "environment steps of each training")->capture_default_str();
  app.add_option("--rounds", options.rounds, "rounds, of which the medians are printed")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  app.add_option("--policy", options.policy, "further options of the policy_service")->allow_extra_args();
  return citylearn::bench::run(app, argc, argv, [&] {
    std::printf("%-13s %-11s %9s %9s %11s %8s %8s\n", "agent", "middleware", "services", "steps/s", "inference",
                "update", "ratio");
    for (const std::string& agent : options.agents)
      for (const std::string& middleware : options.middlewares) compare(options, agent, middleware);
  });
}
