// SPDX-License-Identifier: Apache-2.0
// See README.md.
#include <algorithm>
#include <cstdio>
#include <functional>
#include <map>
#include <string>

#include "bench/bench.h"
#include "bench/figures.h"
#include "bench/program.h"
#include "core/wire/node.h"

namespace {

using namespace citylearn;
using bench::median;
using testing::Service;

constexpr int kDomain = 154;

struct Startup {
  double env = 0, policy = 0;  // seconds
};

/// Returns the seconds until the node takes a message of this type. Throws Error after a minute.
template <class Message>
double time_until(Node& node, Clock::time_point since, const std::function<bool(const Message&)>& is_it) {
  Message message;
  while (seconds_since(since) < 60) {
    while (node.take(message))
      if (is_it(message)) return seconds_since(since);
    node.wait(Clock::now() + std::chrono::milliseconds(50));
  }
  throw Error("did not come within a minute", "a message");
}

/// Starts an env_service on the drawn city, then another one with features and a policy_service. Listens to what they
/// say first.
Startup start(const std::string& middleware) {
  const testing::Folder folder;
  const auto wired = [&](std::vector<std::string> command) {
    return bench::on_wire(std::move(command), middleware, kDomain);
  };
  NodeOptions options;
  options.service = options.id = "listener";
  options.session = "bench-" + std::to_string(getpid());
  options.middleware.name = middleware;
  options.middleware.domain = kDomain;
  Node node(options);
  node.create_reader<msg::TraversalInfo>();
  node.create_reader_at<msg::Observation>("numbers");

  Startup result;
  const auto announces = [](const std::string& id) {
    return [id](const msg::TraversalInfo& info) { return info.header().sender() == id; };
  };
  {
    const Clock::time_point begin = Clock::now();
    const Service env(wired({CITYLEARN_ENV_SERVICE, "--id", "pictures", "--frames", "0:128"}), folder / "pictures.log");
    result.env = time_until<msg::TraversalInfo>(node, begin, announces("pictures"));
  }
  const Service env(wired({CITYLEARN_ENV_SERVICE, "--id", "numbers", "--synthetic-images", "0"}), folder / "env.log");
  time_until<msg::TraversalInfo>(node, Clock::now(),
                                 [](const msg::TraversalInfo& info) { return info.header().sender() == "numbers"; });
  const Clock::time_point started = Clock::now();
  const Service policy(wired({CITYLEARN_POLICY_SERVICE, "--agent", "place_filter", "--steps", "2000", "--tasks", "1"}),
                       folder / "policy.log");
  result.policy = time_until<msg::Observation>(
      node, started, [](const msg::Observation& observation) { return observation.step() > 0; });
  return result;
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> middlewares = {"cyclonedds", "fastdds"};
  int rounds = 7;
  CLI::App app("How long services take to start", "bench_startup");
  app.add_option("--middleware", middlewares, "vendors")->capture_default_str();
  app.add_option("--rounds", rounds, "rounds")->check(CLI::Range(1, 1000))->capture_default_str();
  return bench::run(app, argc, argv, [&] {
    std::map<std::string, std::vector<double>> env, policy, program;
    for (int round = 0; round < rounds; ++round)
      for (const std::string& middleware : middlewares) {
        const Startup startup = start(middleware);
        env[middleware].push_back(startup.env);
        policy[middleware].push_back(startup.policy);
        const testing::Folder folder;
        program[middleware].push_back(bench::seconds([&] {
          Service version({CITYLEARN_POLICY_SERVICE, "--version"}, folder / "version");
          bench::finish(version, "policy_service --version");
        }));
      }
    std::printf("%d rounds, milliseconds: median (lowest, highest)\n", rounds);
    const auto show = [](const std::string& what, const std::string& middleware, std::vector<double> times) {
      const auto [least, most] = std::minmax_element(times.begin(), times.end());
      std::printf("%-11s %-44s %6.0f (%.0f, %.0f)\n", middleware.c_str(), what.c_str(), 1e3 * median(times),
                  1e3 * *least, 1e3 * *most);
      bench::record_figure({.name = middleware + ", " + what,
                            .value = 1e3 * median(times),
                            .unit = "ms",
                            .better = bench::Better::kLower});
    };
    for (const std::string& middleware : middlewares) {
      show("policy_service --version", middleware, program[middleware]);
      show("policy_service to its first step", middleware, policy[middleware]);
      show("env_service to its announcement", middleware, env[middleware]);
    }
  });
}
