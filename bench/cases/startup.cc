// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "bench/cases/cases.h"
#include "bench/program.h"
#include "core/wire/node.h"
#include "tests/support/options.h"

namespace citylearn::bench {
namespace {

/// Returns the seconds until the node takes such a message. Throws Error after a minute.
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

/// Starts each service once and adds the seconds to those of what is measured. Listens to what they say first.
void start(const std::string& middleware, std::map<std::string, std::vector<double>>& times) {
  Session session(middleware);
  Node node({testing::middleware_options(middleware, kDomain), "listener", "listener", session.name()});
  node.create_reader<msg::TraversalInfo>();
  node.create_reader_at<msg::Observation>("numbers");
  const auto time_to_announcement = [&](Clock::time_point since, const std::string& id) {
    return time_until<msg::TraversalInfo>(node, since,
                                          [&](const msg::TraversalInfo& info) { return info.header().sender() == id; });
  };

  Clock::time_point begin = Clock::now();
  testing::Service& env = session.start({CITYLEARN_ENV_SERVICE, "--id", "pictures", "--frames", "0:128"}, "pictures");
  times["env_service to its announcement"].push_back(time_to_announcement(begin, "pictures"));
  env.end(SIGKILL, std::chrono::seconds(10));
  session.start({CITYLEARN_ENV_SERVICE, "--id", "numbers", "--synthetic-images", "0"}, "env");
  time_to_announcement(Clock::now(), "numbers");
  begin = Clock::now();
  session.start({CITYLEARN_POLICY_SERVICE, "--agent", "place_filter", "--steps", "2000", "--tasks", "1"}, "policy");
  times["policy_service to its first step"].push_back(time_until<msg::Observation>(
      node, begin, [](const msg::Observation& observation) { return observation.step() > 0; }));
}

void measure(const std::vector<std::string>& middlewares, int rounds) {
  std::map<std::string, std::map<std::string, std::vector<double>>> all;
  for (int round = 0; round < rounds; ++round)
    for (const std::string& middleware : middlewares) {
      start(middleware, all[middleware]);
      const testing::Folder folder;
      all[middleware]["policy_service --version"].push_back(seconds([&] {
        testing::Service version({CITYLEARN_POLICY_SERVICE, "--version"}, folder / "version");
        finish(version, "policy_service --version");
      }));
    }
  std::printf("%d rounds, milliseconds: median (lowest, highest)\n", rounds);
  for (const auto& [middleware, figures] : all)
    for (const auto& [what, times] : figures) {
      const auto [least, most] = std::minmax_element(times.begin(), times.end());
      std::printf("%-11s %-44s %6.0f (%.0f, %.0f)\n", middleware.c_str(), what.c_str(), 1e3 * median(times),
                  1e3 * *least, 1e3 * *most);
      record_figure(
          {.name = middleware + ", " + what, .value = 1e3 * median(times), .unit = "ms", .better = Better::kLower});
    }
}

}  // namespace

Measure startup(CLI::App& command) {
  const auto middlewares = std::make_shared<std::vector<std::string>>(testing::Arguments{"cyclonedds", "fastdds"});
  const auto rounds = std::make_shared<int>(7);
  command.add_option("--middleware", *middlewares, "vendors");
  command.add_option("--rounds", *rounds, "rounds")->check(CLI::Range(1, 1000));
  return [=] { measure(*middlewares, *rounds); };
}

}  // namespace citylearn::bench
