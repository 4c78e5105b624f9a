// SPDX-License-Identifier: Apache-2.0
// See README.md.
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string>

#include "bench/bench.h"
#include "bench/figures.h"
#include "bench/program.h"

namespace {

using namespace citylearn::testing;
using Json = nlohmann::json;
using citylearn::bench::finish;
using citylearn::bench::on_wire;

/// The "train" part of summary.json after training over DDS.
Json train_over(const std::string& middleware, const std::string& steps, const std::string& agents,
                const std::string& math) {
  const Folder folder;
  const std::vector<std::string> env = {CITYLEARN_ENV_SERVICE, "--agents", agents, "--synthetic-images", "0"};
  std::vector<std::string> policy = {CITYLEARN_POLICY_SERVICE, "--agent", "features", "--steps", steps, "--tasks", "1"};
  policy.insert(policy.end(), {"--evaluate", "summer", "--wait", "30", "--output", folder / "out", "--math", math});
  const Service host(on_wire(env, middleware, 150), folder / "env.log");
  Service learner(on_wire(policy, middleware, 150), folder / "policy.log");
  finish(learner, middleware);
  return Json::parse(contents(folder / "out/summary.json"))["train"];
}

/// Steps per second of the same training in one process.
double train_inside(const std::string& steps, const std::string& math) {
  const Folder folder;
  Service training({CITYLEARN_BENCH_TRAINING, "--dataset", "synthetic", "--evaluate", "summer", "--agent", "features",
                    "--set", "steps=" + steps, "--tasks", "1", "--print-every", "1000000", "--math", math},
                   folder / "log");
  const std::string output = finish(training, "bench_training");
  const std::string::size_type end = output.find(" steps/s");
  if (end == std::string::npos) throw citylearn::Error("bench_training prints no steps/s:\n" + output);
  const std::string::size_type begin = output.find_last_of(" \n", end - 1) + 1;
  return std::stod(output.substr(begin, end - begin));
}

}  // namespace

int main(int argc, char** argv) {
  std::string steps = "120000", math = "onednn";
  CLI::App app("Training over DDS beside training in one process", "bench_loop");
  app.add_option("steps", steps, "environment steps")->capture_default_str();
  app.add_option("--math", math, "library that multiplies matrices, as policy_service's")->capture_default_str();
  return citylearn::bench::run(app, argc, argv, [&] {
    Folder folder;
    Service ask({CITYLEARN_POLICY_SERVICE, "--agent", "features", "--recommended-agents"}, folder / "agents");
    const std::string agents = std::to_string(std::stoi(finish(ask, "policy_service")));
    const double reference = train_inside(steps, math);
    std::printf("features (512 -> LSTM 256), %s agents, %s steps\n", agents.c_str(), steps.c_str());
    std::printf("%-12s %9s %10s %8s %8s %14s\n", "middleware", "steps/s", "inference", "update", "rest",
                "of one process");
    std::printf("%-12s %9.0f %10s %8s %8s %14s\n", "(none)", reference, "", "", "", "1.00");
    citylearn::bench::record_figure({.name = "in one process", .value = reference, .unit = "steps/s"});
    for (const std::string middleware : {"cyclonedds", "fastdds"}) {
      const Json train = train_over(middleware, steps, agents, math);
      const double wall = train["wall_s"], inference = train["inference_s"], update = train["update_s"],
                   rate = train["steps_per_s"];
      std::printf("%-12s %9.0f %8.0f %% %6.0f %% %6.0f %% %14.2f\n", middleware.c_str(), rate, 100 * inference / wall,
                  100 * update / wall, 100 * (1 - (inference + update) / wall), rate / reference);
      std::fflush(stdout);
      citylearn::bench::record_figure({.name = middleware, .value = rate, .unit = "steps/s"});
    }
    Service products({CITYLEARN_BENCH_TRAINING, "--products", "--math", math}, folder / "products");
    std::cout << "\n" << finish(products, "bench_training --products");
  });
}
