// SPDX-License-Identifier: Apache-2.0
// The simulation that docs/explanation/scaling.md extrapolates with (bench/scale).
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <optional>

#include "bench/scale/calibration.h"
#include "bench/scale/simulation.h"
#include "core/util/error.h"
#include "core/util/random.h"
#include "tests/paths.h"
#include "tests/support/text.h"

namespace citylearn::scale {
namespace {

Costs some_costs() {
  Costs costs;
  costs.send = 4e-6, costs.send_byte = 0.4e-9;
  costs.receive = 6e-6, costs.receive_byte = 0.3e-9;
  costs.take = 2e-6, costs.take_byte = 0.2e-9;
  costs.env_tick = 10e-6, costs.env_agent = 0.3e-6;
  costs.actor_tick = 5e-6, costs.actor_agent = 4e-6;
  costs.update_step = 8e-6, costs.update = 300e-6;
  return costs;
}

Sizes some_sizes() {
  Sizes sizes;
  sizes.observation = 4800, sizes.action = 350, sizes.trajectory = 19000, sizes.acknowledgement = 350;
  sizes.chunk = 49500, sizes.chunks = 2, sizes.episode = 450, sizes.episode_acknowledgement = 320;
  return sizes;
}

/// Poisson arrivals at a thread that has a processor of its own, each as much work.
double mean_wait(double load, double service, int arrivals) {
  Events events;
  Machine machine(events, 1);
  Thread thread(machine);
  Random random{7};
  double waited = 0;
  int done = 0;
  std::function<void()> arrive = [&] {
    const double came = events.now();
    thread.add(service, [&, came] {
      waited += events.now() - came - service;
      ++done;
    });
    events.after(-std::log(1 - random.uniform()) * service / load, arrive);
  };
  arrive();
  while (done < arrivals) events.run_until(events.now() + 1000 * service);
  return waited / done;
}

TEST(Queue, WaitsAsLongAsTheFormulaOfConstantWorkSays) {
  constexpr double kService = 1e-3;
  for (const double load : {0.3, 0.6, 0.9}) {
    // Pollaczek and Khinchine, without spread of the service time.
    const double formula = load * kService / (2 * (1 - load));
    EXPECT_NEAR(mean_wait(load, kService, 100000), formula, 0.05 * formula) << load;
  }
}

TEST(Queue, OnlyWhoSleptIsWoken) {
  Events events;
  Machine machine(events, 1);
  Thread thread(machine, 0.5);
  std::vector<double> ended;
  for (int i = 0; i < 2; ++i) thread.add(1, [&] { ended.push_back(events.now()); });
  events.run_until(10);
  thread.add(1, [&] { ended.push_back(events.now()); });
  events.run_until(20);
  EXPECT_EQ(ended, (std::vector<double>{1.5, 2.5, 11.5}));
  EXPECT_EQ(thread.used(), 4);
}

TEST(Queue, ThreadsShareProcessorsAlike) {
  Events events;
  Machine machine(events, 2);
  Thread a(machine), b(machine), c(machine);
  double ended[3] = {};
  a.add(1, [&] { ended[0] = events.now(); });
  b.add(1, [&] { ended[1] = events.now(); });
  c.add(2, [&] { ended[2] = events.now(); });
  events.run_until(10);
  // Three on two: each has two thirds, until two are done; the third one then has a processor alone.
  EXPECT_NEAR(ended[0], 1.5, 1e-9);
  EXPECT_NEAR(ended[1], 1.5, 1e-9);
  EXPECT_NEAR(ended[2], 2.5, 1e-9);
  EXPECT_NEAR(machine.used(), 4, 1e-9);
}

TEST(Queue, LinksPassBytesInOrderAtTheirRate) {
  Events events;
  Link link(events, 1000);
  std::vector<double> passed;
  link.send(500, [&] { passed.push_back(events.now()); });
  link.send(100, [&] { passed.push_back(events.now()); });
  events.run_until(2);
  link.send(100, [&] { passed.push_back(events.now()); });
  events.run_until(3);
  ASSERT_EQ(passed.size(), 3u);
  EXPECT_NEAR(passed[0], 0.5, 1e-9);
  EXPECT_NEAR(passed[1], 0.6, 1e-9);
  EXPECT_NEAR(passed[2], 2.1, 1e-9);
}

TEST(Simulation, LosesNoTrajectoryAndKeepsToItsWindows) {
  for (const int actors : {1, 3}) {
    Layout layout;
    layout.envs = 6, layout.actors = actors, layout.cores = 4;
    const Outcome o = simulate(layout, some_costs(), some_sizes());
    EXPECT_GT(o.updates, 20u);
    EXPECT_EQ(o.trajectories_taken, o.trajectories_learned + o.trajectories_waiting);
    EXPECT_LE(o.trajectories_taken, o.trajectories_sent);
    EXPECT_LE(o.trajectories_sent - o.trajectories_taken, 48u * actors);
    const auto batch = static_cast<std::uint64_t>(layout.batch);
    EXPECT_GE(o.trajectories_learned, o.updates * batch);
    EXPECT_LE(o.trajectories_learned, (o.updates + 1) * batch);  // of the last one perhaps half
    EXPECT_LE(o.most_unacknowledged, static_cast<std::uint64_t>(layout.window));
    EXPECT_LE(o.most_queued, 2u * static_cast<std::uint64_t>(layout.batch));
    // In the long run as many steps are learned from as are taken: nothing is kept but what the windows allow.
    const double kept =
        layout.envs * layout.agents * layout.steps * (layout.window + 1.0) + 2.0 * layout.batch * layout.steps;
    EXPECT_NEAR(o.learned_per_second, o.steps_per_second, kept / Options().seconds);
  }
}

TEST(Simulation, IsTheSameForTheSameSeed) {
  Layout layout;
  layout.envs = 4, layout.actors = 2;
  Options options;
  options.seconds = 0.5;
  const Outcome a = simulate(layout, some_costs(), some_sizes(), options);
  const Outcome b = simulate(layout, some_costs(), some_sizes(), options);
  EXPECT_EQ(a.steps_per_second, b.steps_per_second);
  EXPECT_EQ(a.answer, b.answer);
  EXPECT_EQ(a.lag, b.lag);
  options.seed = 2;
  EXPECT_NE(simulate(layout, some_costs(), some_sizes(), options).answer, a.answer);
}

TEST(Simulation, ASlowLearnerMakesActorsWaitAndAFastOneDoesNot) {
  Layout layout;
  layout.envs = 4, layout.cores = 8;
  Costs costs = some_costs();
  costs.update_step = 100e-6;
  const Outcome slow = simulate(layout, costs, some_sizes());
  EXPECT_GT(slow.blocked, 0.5);
  EXPECT_NEAR(slow.learned_per_second, 1 / (costs.update_step + costs.update / 1024), 0.1 / costs.update_step);
  costs.update_step = 0.1e-6, costs.update = 10e-6;
  const Outcome fast = simulate(layout, costs, some_sizes());
  EXPECT_LT(fast.blocked, 0.05);
  EXPECT_GT(fast.steps_per_second, 3 * slow.steps_per_second);
}

TEST(Simulation, HandingOverMoreAtATimeChangesLittle) {
  Layout layout;
  layout.envs = 8, layout.actors = 4, layout.hosts = 4;
  layout.learner_speed = 1000;  // all is then in the transport
  Options fine, coarse;
  fine.warm_up = coarse.warm_up = 0.3;
  fine.seconds = coarse.seconds = 0.3;
  fine.gather = 50e-6, coarse.gather = 1e-3;
  const double one = simulate(layout, some_costs(), some_sizes(), fine).steps_per_second;
  const double other = simulate(layout, some_costs(), some_sizes(), coarse).steps_per_second;
  EXPECT_NEAR(other, one, 0.1 * one);
}

TEST(Simulation, WhatIsAddressedCostsOthersNothing) {
  Layout layout;
  layout.envs = 32, layout.actors = 8, layout.hosts = 8;
  layout.learner_speed = 1000;
  Options options;
  options.warm_up = options.seconds = 0.3, options.gather = 0.5e-3;
  const Outcome all = simulate(layout, some_costs(), some_sizes(), options);
  layout.addressed_steps = layout.addressed_acknowledgements = true;
  const Outcome addressed = simulate(layout, some_costs(), some_sizes(), options);
  EXPECT_NEAR(all.env_sent / addressed.env_sent, layout.actors, 0.3 * layout.actors);
  EXPECT_GT(addressed.steps_per_second, 2 * all.steps_per_second);
}

/// What bench_scale measured with `middleware`, as it is in the repository.
std::vector<Measured> measured(const std::string& middleware) {
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(CITYLEARN_SOURCE_DIR "/bench/scale/measured"))
    if (entry.path().filename().string().starts_with(middleware)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return read_measured(files);
}

class Vendors : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Calibration, Vendors, ::testing::Values("cyclonedds", "fastdds"),
                         [](const auto& each) { return each.param; });

TEST_P(Vendors, AMeasuredCaseFollowsFromTheOthers) {
  std::vector<Measured> others;
  std::optional<Measured> wanted;
  for (const Measured& m : measured(GetParam())) {
    if (!simulated(m) || m.agent != "place_filter") continue;
    if (m.envs == 4 && m.agents == 16 && m.actors == 2)
      wanted = m;
    else
      others.push_back(m);
  }
  ASSERT_TRUE(wanted.has_value());
  ASSERT_GT(others.size(), 10u);
  const Outcome o = simulate(layout_of(*wanted), calibrate(others), sizes_of("place_filter", 16, 64));
  const auto microseconds = [&](const char* kind) {
    const Used& used = wanted->used("run", kind);
    return used["main_us"] + used["others_us"];
  };
  const auto within = [](double is, double should, double share) { EXPECT_NEAR(is, should, share * should); };
  const Used &env = wanted->used("run", "env"), &actor = wanted->used("run", "actor");
  within(o.steps_per_second, env["steps_per_s"], 0.2);
  within(1e6 * o.env_cpu, microseconds("env"), 0.2);
  within(1e6 * o.actor_cpu, microseconds("actor"), 0.2);
  within(1e6 * o.learner_cpu, microseconds("learner"), 0.2);
  within(o.lag, env["lag"], 0.2);
  // The middlewares' own heartbeats and announcements are not simulated.
  within(o.env_sent, env["sent_bytes"], 0.1);
  within(o.actor_received, actor["received_bytes"], 0.1);
}

TEST(Measured, WrongFilesAreNamedWithTheirLine) {
  const std::string path = ::testing::TempDir() + "scale_test_" + std::to_string(getpid()) + ".csv";
  const auto complaint = [&](const std::string& text) -> std::string {
    std::ofstream(path) << text;
    return testing::error_of([&] { read_measured({path}); });
  };
  EXPECT_NE(complaint("a,b\n1\n").find(path + ":2"), std::string::npos);
  EXPECT_NE(complaint("a,b\n1,x\n").find("'x' is no number"), std::string::npos);
  EXPECT_NE(complaint("a,b\n1,2\n").find("column"), std::string::npos);
  std::filesystem::remove(path);
  EXPECT_THROW(read_measured({path}), Error);
}

}  // namespace
}  // namespace citylearn::scale
