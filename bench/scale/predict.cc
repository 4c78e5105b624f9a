// SPDX-License-Identifier: Apache-2.0
// See README.md.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>

#include "bench/scale/calibration.h"
#include "core/util/error.h"

namespace {

using namespace citylearn;
using namespace citylearn::scale;

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0 : values[values.size() / 2];
}

/// Each case by what the others say: none of its own figures but the processors it had and how often episodes ended.
void check(const std::vector<Measured>& cases) {
  std::printf("\n%-14s %17s %17s %17s %17s %12s %16s %16s %16s\n", "case", "steps/s", "env_service us", "actor us",
              "learner us", "lag, updates", "env bytes out", "actor bytes out", "learner bytes out");
  std::vector<double> errors[7];
  for (std::size_t i = 0; i < cases.size(); ++i) {
    std::vector<Measured> others = cases;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    const Measured& m = cases[i];
    Options options;
    options.warm_up = 2, options.seconds = 4;
    const Outcome o = simulate(layout_of(m), calibrate(others), sizes_of(m.agent, m.agents, m.dimension), options);
    const auto us = [&](const char* kind) {
      const Used& used = m.used("run", kind);
      return used["main_us"] + used["others_us"];
    };
    const Used& env = m.used("run", "env");
    const double pairs[7][2] = {{o.steps_per_second, env["steps_per_s"]},
                                {1e6 * o.env_cpu, us("env")},
                                {1e6 * o.actor_cpu, us("actor")},
                                {1e6 * o.learner_cpu, us("learner")},
                                {o.env_sent, env["sent_bytes"]},
                                {o.actor_sent, m.used("run", "actor")["sent_bytes"]},
                                {o.learner_sent, m.used("run", "learner")["sent_bytes"]}};
    std::printf("%-14s", m.name().c_str());
    for (int k = 0; k < 7; ++k) {
      const double error = pairs[k][0] / pairs[k][1] - 1;
      errors[k].push_back(std::abs(error));
      std::printf(k == 0  ? " %6.0f/%-6.0f%+3.0f%%"
                  : k < 4 ? " %6.2f/%-6.2f%+3.0f%%"
                          : " %6.1f/%-5.1f%+3.0f%%",
                  pairs[k][0], pairs[k][1], 100 * error);
      if (k == 3) std::printf("    %4.1f/%-4.1f", o.lag, env["lag"]);
    }
    std::printf("\n");
  }
  std::printf("%-14s", "median error");
  for (int k = 0; k < 7; ++k) std::printf(k == 4 ? "%29.0f%%" : " %16.0f%%", 100 * median(errors[k]));
  std::printf("\n");
}

void print(const Costs& c) {
  std::printf("\nmicroseconds (nanoseconds a byte): send a copy %.2f (%.2f), receive %.2f (%.2f), take %.2f (%.2f)\n",
              1e6 * c.send, 1e9 * c.send_byte, 1e6 * c.receive, 1e9 * c.receive_byte, 1e6 * c.take, 1e9 * c.take_byte);
  std::printf("to wake a thread of the middleware %.2f, the service's own %.2f\n", 1e6 * c.wake_middleware,
              1e6 * c.wake);
  std::printf(
      "env_service: a tick %.2f, an agent %.3f; actor: a tick %.2f, an agent %.3f beside %.3f; learner: a step %.3f "
      "beside %.3f, an update %.0f\n",
      1e6 * c.env_tick, 1e6 * c.env_agent, 1e6 * c.actor_tick, 1e6 * c.actor_agent, 1e6 * c.actor_helper,
      1e6 * c.update_step, 1e6 * c.update_helper, 1e6 * c.update);
  std::printf("a second of a service: %.0f, and %.1f for each other service\n", 1e6 * c.background,
              1e6 * c.background_other);
}

struct Scenario {
  std::string name;
  Layout layout;
};

void extrapolate(const std::string& agent, const Costs& costs, const std::vector<Scenario>& scenarios) {
  std::printf("\n%-46s %9s %9s %6s %9s %8s   %s\n", agent.c_str(), "steps/s", "learned/s", "lag", "answer ms",
              "blocked", "busiest; what the learner does");
  for (const Scenario& scenario : scenarios) {
    Options options;
    options.gather = scenario.layout.hosts < 30 ? 1e-3 : 2e-3;
    // Long enough for all windows to be full, and for a number of updates.
    const double update = scenario.layout.batch * scenario.layout.steps * costs.update_step;
    options.warm_up = std::max(8.0, 5 * update), options.seconds = std::max(4.0, 20 * update);
    const Outcome o = simulate(scenario.layout, costs, sizes_of(agent, scenario.layout.agents, 64), options);
    const auto largest = [](const std::map<std::string, double>& shares) {
      std::vector<std::pair<double, std::string>> sorted;
      for (const auto& [what, share] : shares) sorted.emplace_back(share, what);
      std::sort(sorted.rbegin(), sorted.rend());
      std::string text;
      for (std::size_t i = 0; i < std::min<std::size_t>(3, sorted.size()); ++i) {
        char each[80];
        std::snprintf(each, sizeof each, "%s%s %.0f%%", i == 0 ? "" : ", ", sorted[i].second.c_str(),
                      100 * sorted[i].first);
        text += each;
      }
      return text;
    };
    std::printf("%-46s %9.0f %9.0f %6.1f %9.2f %7.0f%%   %s; %s\n", scenario.name.c_str(), o.steps_per_second,
                o.learned_per_second, o.lag, 1e3 * o.answer, 100 * o.blocked, largest(o.busy).c_str(),
                largest(o.learner_does).c_str());
    std::fflush(stdout);
  }
}

/// Hosts of 16 processors with 10 Gbit/s, 100 agents on each: 25 env_services of 16 on four hosts, an actor on each.
Layout cluster(const std::string& agent, int hosts) {
  Layout layout;
  layout.hosts = hosts, layout.cores = 16, layout.link = 1.25e9, layout.latency = 50e-6;
  layout.envs = std::max(1, 25 * hosts / 4), layout.actors = hosts;
  set_agent(layout, agent, 256);
  return layout;
}

std::vector<Scenario> scenarios(const std::string& agent) {
  std::vector<Scenario> all;
  const auto add = [&](const std::string& name, const Layout& layout) { all.push_back({name, layout}); };
  for (const int hosts : {1, 4, 10, 30, 100}) {
    const Layout layout = cluster(agent, hosts);
    add(std::to_string(hosts) + " hosts, " + std::to_string(layout.envs * layout.agents) + " agents", layout);
  }
  // One thing after the other is lifted.
  Layout layout = cluster(agent, 100);
  layout.addressed_acknowledgements = true;
  add("100 hosts, acknowledgements addressed", layout);
  layout.addressed_steps = true;
  add("  and observations and actions", layout);
  layout.learner_speed = 10;
  add("  and a learner 10 times as fast", layout);
  layout.learner_speed = 100;
  add("  and a learner 100 times as fast", layout);
  layout.addressed_steps = false;
  add("  but observations and actions for all", layout);
  // What can be laid out today.
  layout = cluster(agent, 100);
  layout.agents = 100, layout.envs = 100;
  add("100 hosts, an env_service of 100 agents each", layout);
  layout = cluster(agent, 10);
  layout.agents = 100, layout.envs = 10;
  add("10 hosts, likewise (10 such runs)", layout);
  layout = cluster(agent, 1);
  layout.agents = 100, layout.envs = 1;
  add("1 host, likewise (100 such runs)", layout);
  return all;
}

/// Of one service of each kind, per step of one agent of the run.
void print_measured(const std::vector<Measured>& all) {
  std::printf("%-37s %-9s %8s %8s %8s %9s %9s %9s %9s %7s\n", "case", "service", "own us", "vendor's", "sleeps",
              "bytes out", "in", "datagr. out", "in", "lost");
  for (const Measured& m : all) {
    if (!m.ran()) continue;
    for (const auto& [kind, u] : m.phases.at("run"))
      std::printf("%-37s %-9s %8.2f %8.2f %8.3f %9.1f %9.1f %9.4f %9.4f %7.2g   %.0f steps/s\n", m.name().c_str(),
                  kind.c_str(), u["main_us"], u["others_us"], u["main_sleeps"] + u["others_sleeps"], u["sent_bytes"],
                  u["received_bytes"], u["sent_datagrams"], u["received_datagrams"], u["lost"], u["steps_per_s"]);
  }
}

/// All services of a layout together, beside the smallest one.
void print_sums(const std::vector<Measured>& all) {
  std::printf("\n%-38s %9s %9s %10s %8s %8s %8s\n", "all services together, per step", "us", "bytes", "datagrams", "us",
              "bytes", "datagrams");
  double reference[3] = {};
  for (const Measured& m : all) {
    if (!m.ran()) continue;
    double sums[3] = {};
    for (const auto& [kind, u] : m.phases.at("run")) {
      sums[0] += u.count * (u["main_us"] + u["others_us"]);
      sums[1] += u.count * u["sent_bytes"];
      sums[2] += u.count * u["sent_datagrams"];
    }
    if (reference[0] == 0) std::copy(sums, sums + 3, reference);
    std::printf("%-38s %9.1f %9.0f %10.3f %7.2fx %7.2fx %7.2fx\n", m.name().c_str(), sums[0], sums[1], sums[2],
                sums[0] / reference[0], sums[1] / reference[1], sums[2] / reference[2]);
  }
}

/// What it takes to know each other.
void print_discovery(const std::vector<Measured>& all) {
  std::printf("\n%-22s %10s %12s %12s %12s %12s %12s\n", "services that only wait", "start, ms", "start, kB out",
              "datagrams", "idle us/s", "datagrams/s", "resident MB");
  for (const Measured& m : all) {
    if (m.ran()) continue;
    const Used &start = m.used("start", "env"), &idle = m.used("idle", "env");
    std::printf("%-22s %10.1f %12.1f %12.0f %12.0f %12.1f %12.1f\n",
                (std::to_string(m.envs) + (m.ports ? ", ports" : "")).c_str(),
                1e-3 * (start["main_us"] + start["others_us"]), 1e-3 * start["sent_bytes"], start["sent_datagrams"],
                idle["main_us"] + idle["others_us"], idle["sent_datagrams"], idle["resident_mb"]);
  }
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 2) throw Error("name the files that bench_scale wrote with one middleware", "command line");
  const std::vector<Measured> all = read_measured({argv + 1, argv + argc});
  std::vector<Measured> cases, features;
  for (const Measured& m : all) {
    if (!simulated(m)) continue;
    (m.agent == "place_filter" ? cases : features).push_back(m);
  }
  const Costs costs = calibrate(cases);
  print_measured(all);
  print_sums(all);
  print_discovery(all);
  check(cases);
  print(costs);
  extrapolate("place_filter", costs, scenarios("place_filter"));
  if (!features.empty()) {
    const Costs other = calibrate_agent(features, costs);
    print(other);
    extrapolate("features", other, scenarios("features"));
  }
  return 0;
} catch (const std::exception& error) {
  std::cerr << "predict_scale: " << error.what() << "\n";
  return 1;
}
