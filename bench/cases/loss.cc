// SPDX-License-Identifier: Apache-2.0
#include "bench/cases/cases.h"
#include "tests/support/processes/hosts.h"
#include "tests/support/text.h"

namespace citylearn::bench {
namespace {

using namespace citylearn::testing;
using std::chrono::seconds;

constexpr int kPhases = 6;
constexpr seconds kPhase{2}, kWaitTimeout{60};

/// Returns the steps trained up to now, and the seconds of training at the last of them.
std::pair<double, double> progress(const std::string& folder) {
  const std::string text = contents(folder + "/metrics.csv");
  const std::vector<std::string> rows = lines_of(text.substr(0, text.rfind('\n') + 1));
  if (rows.size() < 2) return {0, 0};
  const std::vector<std::string> fields = split(rows.back(), ',');
  return {std::stod(fields.at(1)), std::stod(fields.at(4))};
}

void compare(const std::string& middleware, int percent) {
  if (const std::string reason = Hosts::unavailable(); !reason.empty()) throw Error(reason);
  Hosts hosts(3);
  const Folder folder;
  const auto start = [&](int host, Arguments command, const std::string& name, const std::string& peers) {
    command.insert(command.end(), {"--middleware", middleware, "--interface", Hosts::interface(), "--peers", peers});
    return hosts.start(host, command, folder / (name + ".log"));
  };
  std::vector<std::unique_ptr<Service>> envs;
  for (const int host : {1, 2, 1, 2}) {
    const std::string id = "env-" + std::to_string(envs.size());
    envs.push_back(start(host, {CITYLEARN_ENV_SERVICE, "--id", id, "--agents", "8", "--synthetic-images", "0"}, id,
                         Hosts::address(0)));
  }
  const auto policy = start(0,
                            {CITYLEARN_POLICY_SERVICE, "--agent", "place_filter", "--environments", "4", "--steps",
                             "1000000000", "--output", folder / "out"},
                            "policy", Hosts::address(1) + "," + Hosts::address(2));
  if (!poll_until([&] { return progress(folder / "out").first > 0; }, kWaitTimeout))
    throw Error("does not train:\n" + policy->output());
  double steps[2] = {0, 0}, time[2] = {0, 0};
  for (int phase = 0; phase < kPhases; ++phase) {
    const int lossy = phase % 2;
    hosts.lose(lossy ? percent : 0);
    const auto [steps_before, time_before] = progress(folder / "out");
    if (policy->wait(kPhase)) throw Error("training failed:\n" + policy->output());
    const auto [steps_after, time_after] = progress(folder / "out");
    steps[lossy] += steps_after - steps_before;
    time[lossy] += time_after - time_before;
  }
  const double calm = steps[0] / time[0], lossy = steps[1] / time[1];
  std::printf("%s: %.0f steps/s without loss, %.0f with %d %%: ratio %.2f\n", middleware.c_str(), calm, lossy, percent,
              lossy / calm);
}

}  // namespace

Measure loss(CLI::App& command) {
  const auto middleware = std::make_shared<std::string>("cyclonedds");
  const auto percent = std::make_shared<int>(5);
  command.add_option("middleware", *middleware, "cyclonedds or fastdds");
  command.add_option("percent", *percent, "packets lost")->check(CLI::Range(1, 50));
  return [=] { compare(*middleware, *percent); };
}

}  // namespace citylearn::bench
