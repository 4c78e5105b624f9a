// SPDX-License-Identifier: Apache-2.0
// See README.md.
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "bench/bench.h"
#include "bench/figures.h"
#include "bench/program.h"
#include "core/util/random.h"

namespace {

using namespace citylearn::testing;
using Json = nlohmann::json;
using Arguments = std::vector<std::string>;
using citylearn::bench::finish;
using citylearn::bench::median;

/// Writes a features file of 128 frames x 64.
void write_features(const std::string& path) {
  citylearn::Random random(1);
  std::ofstream out(path);
  for (int frame = 0; frame < 128; ++frame)
    for (int k = 0; k < 64; ++k) out << random.normal() / 8 << (k == 63 ? '\n' : ',');
}

class Bench {
 public:
  explicit Bench(std::string middleware) : middleware_(std::move(middleware)) {
    std::filesystem::create_directories(folder_ / "data");
    write_features(folder_ / "data/summer.csv");
  }

  /// Environment steps per second of one training.
  double train(const std::string& agent, const std::string& steps, bool images) {
    ++runs_;
    Service ask({CITYLEARN_POLICY_SERVICE, "--agent", agent, "--recommended-agents"}, folder_ / "agents");
    const std::string agents = std::to_string(std::stoi(finish(ask, "policy_service")));
    Arguments env = {CITYLEARN_ENV_SERVICE, "--traversal", "summer", "--agents", agents};
    const Arguments source = images ? Arguments{"--dataset", "synthetic", "--frames", "0:128"}
                                    : Arguments{"--dataset", "plain", "--data", folder_ / "data"};
    env.insert(env.end(), source.begin(), source.end());
    const auto host = start(env, "env.log");
    std::unique_ptr<Service> encoder;
    if (images) encoder = start({CITYLEARN_ENCODER_SERVICE, "--store", folder_ / "store"}, "encoder.log");
    const std::string out = folder_ / ("out-" + std::to_string(runs_));
    const auto policy = start({CITYLEARN_POLICY_SERVICE, "--agent", agent, "--steps", steps, "--tasks", "1",
                               "--evaluate", "summer", "--wait", "60", "--output", out},
                              "policy.log");
    finish(*policy, "training");
    return Json::parse(contents(out + "/summary.json"))["train"]["steps_per_s"];
  }

 private:
  std::unique_ptr<Service> start(Arguments command, const std::string& log) {
    command = citylearn::bench::on_wire(std::move(command), middleware_, 151, "-" + std::to_string(runs_));
    return std::make_unique<Service>(std::move(command), folder_ / log);
  }

  Folder folder_;
  std::string middleware_;
  int runs_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  int rounds = 5;
  std::string middleware = "cyclonedds";
  CLI::App app("Training on pictures beside training on features, over DDS", "bench_images");
  app.add_option("rounds", rounds, "rounds")->capture_default_str();
  app.add_option("middleware", middleware, "cyclonedds or fastdds")->capture_default_str();
  return citylearn::bench::run(app, argc, argv, [&] {
    Bench bench(middleware);
    std::printf("%-14s %10s %16s %16s %8s\n", "agent", "steps", "features/s", "images/s", "ratio");
    for (const auto& [agent, steps] :
         {std::pair<std::string, std::string>{"place_filter", "400000"}, {"features", "60000"}}) {
      bench.train(agent, "10000", true);  // fills the store
      std::vector<double> features, images;
      for (int round = 0; round < rounds; ++round) {
        features.push_back(bench.train(agent, steps, false));
        images.push_back(bench.train(agent, steps, true));
      }
      std::printf("%-14s %10s %16.0f %16.0f %8.2f\n", agent.c_str(), steps.c_str(), median(features), median(images),
                  median(images) / median(features));
      citylearn::bench::record_figure({.name = agent + ", features", .value = median(features), .unit = "steps/s"});
      citylearn::bench::record_figure({.name = agent + ", images", .value = median(images), .unit = "steps/s"});
      std::fflush(stdout);
    }
  });
}
