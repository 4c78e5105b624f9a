// SPDX-License-Identifier: Apache-2.0
#include <fstream>
#include <nlohmann/json.hpp>

#include "bench/cases/cases.h"
#include "core/util/processors.h"
#include "env_service/dataset_io/dataset.h"
#include "policy_service/network/layers/product.h"
#include "tools/lab/training.h"

namespace citylearn::bench {
namespace {

using testing::Arguments;

struct Options {
  std::vector<std::string> agents = {"features"}, middlewares = {"cyclonedds"};
  int steps = 40000, rounds = 1, services = 16;
  std::string math = "onednn";
  Arguments policy = {};  ///< further options of the policy_service
};

/// A training, by services of its own.
struct Layout {
  std::string figure;             ///< the name of its steps per second
  std::string middleware, agent;  ///< without a middleware it is in one process
  int steps = 0, environments = 1, agents_each = 0, actors = 0;
  Arguments policy = {};
  std::string keys = {};  ///< a keystore with keys of env-0 and policy; empty: nothing is secured
};

/// What a training takes: steps per second, shares of the time, updates, seconds.
struct Cost {
  double rate = 0, inference = 0, update = 0, lag = 0, actors_waited = 0;
};

/// Returns the steps per second from the first row of a metrics.csv to the last. Throws Error unless it has two rows.
double training_rate(const std::string& path) {
  std::ifstream in(path);
  double steps[2] = {}, wall[2] = {};
  std::string line;
  for (int row = -1; std::getline(in, line); ++row) {
    double update, episodes, lesson;
    if (row < 0 ||
        std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf,%lf", &update, &steps[1], &episodes, &lesson, &wall[1]) != 5)
      continue;
    if (row == 0) steps[0] = steps[1], wall[0] = wall[1];
  }
  if (wall[1] <= wall[0]) throw Error("has fewer than two updates", path, "train for more steps");
  return (steps[1] - steps[0]) / (wall[1] - wall[0]);
}

/// Waits until the program has ended. Throws Error unless its exit status is 0.
void finish(testing::Service& program, const std::string& what) {
  if (program.wait(std::chrono::minutes(20)) != 0) throw Error(what + " failed:\n" + program.output());
}

/// Makes a keystore in a folder that is not there yet, with keys of env-0 and policy. Throws Error.
void make_keystore(const std::string& keys) {
  for (const Arguments& words : {Arguments{"create", keys}, Arguments{"add", keys, "env_service", "env-0"},
                                 Arguments{"add", keys, "policy_service", "policy"}}) {
    Arguments command = {CITYLEARN_SOURCE_DIR "/compose/keystore"};
    command.insert(command.end(), words.begin(), words.end());
    testing::Service program(command, keys + ".log");
    finish(program, "keystore");
  }
}

Cost train_inside(const Layout& layout) {
  const auto& entry = DatasetRegistry::instance().find("dataset", "synthetic");
  const Traversal route = entry.create(Parameters("dataset", entry.parameters, {{"images", 0}}), "")->load("summer");
  TrainerOptions options;
  options.agent = layout.agent;
  options.trainer_parameters["steps"] = layout.steps;
  InprocessTraining training(options, route, 128);
  const Clock::time_point begin = Clock::now();
  while (!training.trainer().done()) training.update();
  const double wall = seconds_since(begin);
  const double steps = static_cast<double>(training.trainer().progress().steps);
  return {.rate = steps / wall, .inference = training.acting() / wall, .update = training.learning() / wall};
}

/// The rate is that from the first update to the last: without the time in which services find each other.
Cost train(const Layout& layout) {
  if (layout.middleware.empty()) return train_inside(layout);
  Session session(layout.middleware);
  const auto start = [&](const std::string& program, const std::string& id, Arguments command, const Arguments& more) {
    command.insert(command.begin(), {program, "--id", id});
    command.insert(command.end(), more.begin(), more.end());
    if (!layout.keys.empty()) command.insert(command.end(), {"--security", layout.keys + "/" + id});
    return &session.start(command, id);
  };
  for (int i = 0; i < layout.environments; ++i)
    start(CITYLEARN_ENV_SERVICE, "env-" + std::to_string(i),
          {"--traversal", "summer", "--agents", std::to_string(layout.agents_each)}, {"--synthetic-images", "0"});
  for (int i = 0; i < layout.actors; ++i)
    start(CITYLEARN_POLICY_SERVICE, "actor-" + std::to_string(i), {"--role", "actor"}, {});
  const std::string out = session.folder() / "out";
  finish(*start(CITYLEARN_POLICY_SERVICE, "policy",
                {"--role", layout.actors > 0 ? "learner" : "both", "--agent", layout.agent, "--steps",
                 std::to_string(layout.steps), "--environments", std::to_string(layout.environments), "--tasks", "1",
                 "--evaluate", "summer", "--wait", "60", "--output", out},
                layout.policy),
         "training");
  const auto done = nlohmann::json::parse(testing::contents(out + "/summary.json"))["train"];
  const double wall = done["wall_s"], inference = done["inference_s"], update = done["update_s"];
  return {training_rate(out + "/metrics.csv"), inference / wall, update / wall, done["policy_lag"],
          done["actors_waited_s"]};
}

/// Trains in each layout by turns and prints what each costs: medians. A ratio is that to the first layout's rate in
/// the same round.
void compare(const std::vector<Layout>& layouts, int rounds) {
  std::vector<std::vector<Cost>> costs(layouts.size());
  for (int round = 0; round < rounds; ++round)
    for (std::size_t i = 0; i < layouts.size(); ++i) costs[i].push_back(train(layouts[i]));
  const std::string machine = std::to_string(available_processors()) + " processors";
  std::printf("%-40s %9s %6s %10s %8s %13s %17s\n", machine.c_str(), "steps/s", "ratio", "inference", "update",
              "lag, updates", "actors waited, s");
  for (std::size_t i = 0; i < layouts.size(); ++i) {
    const auto middle = [&](auto value) {
      std::vector<double> values;
      for (std::size_t round = 0; round < costs[i].size(); ++round) values.push_back(value(costs[i][round], round));
      return median(values);
    };
    const double rate = middle([](const Cost& cost, std::size_t) { return cost.rate; });
    std::printf("%-40s %9.0f %6.2f %8.0f %% %6.0f %% %13.2f %17.1f\n", layouts[i].figure.c_str(), rate,
                middle([&](const Cost& cost, std::size_t round) { return cost.rate / costs[0][round].rate; }),
                middle([](const Cost& cost, std::size_t) { return 100 * cost.inference; }),
                middle([](const Cost& cost, std::size_t) { return 100 * cost.update; }),
                middle([](const Cost& cost, std::size_t) { return cost.lag; }),
                middle([](const Cost& cost, std::size_t) { return cost.actors_waited; }));
    record_figure({.name = layouts[i].figure, .value = rate, .unit = "steps/s"});
  }
  std::fflush(stdout);
}

int recommended_agents(const std::string& agent) {
  return static_cast<int>(Trainer::recommended_parameters(agent, "ppo").at("trainer").at("agents"));
}

void compare_loops(const Options& options) {
  set_math(options.math);
  for (const std::string& agent : options.agents) {
    std::vector<Layout> layouts = {{"in one process", "", agent, options.steps}};
    for (const std::string& middleware : options.middlewares)
      layouts.push_back({middleware, middleware, agent, options.steps, 1, recommended_agents(agent)});
    for (Layout& layout : layouts) layout.policy = {"--math", options.math};
    compare(layouts, options.rounds);
  }
}

void compare_roles(const Options& options) {
  for (const std::string& agent : options.agents)
    for (const std::string& middleware : options.middlewares) {
      std::vector<Layout> layouts = {{"role both", middleware, agent, options.steps, 1, 16}};
      for (const int actors : {1, 2, 4})
        layouts.push_back({"actors: " + std::to_string(actors), middleware, agent, options.steps, actors, 16, actors});
      for (Layout& layout : layouts) layout.policy = {"--trainer-agents", "16"};
      std::printf("%s, %s\n", agent.c_str(), middleware.c_str());
      compare(layouts, options.rounds);
    }
}

void compare_services(const Options& options) {
  for (const std::string& agent : options.agents)
    for (const std::string& middleware : options.middlewares) {
      std::vector<Layout> layouts;
      for (const int count : {1, options.services})
        layouts.push_back({agent + ", " + middleware + ", " + std::to_string(count) + " env_services", middleware,
                           agent, options.steps, count, options.services / count});
      for (Layout& layout : layouts) layout.policy = options.policy;
      compare(layouts, options.rounds);
    }
}

void compare_secured(const Options& options) {
  const testing::Folder folder;
  const std::string keys = folder / "keys";
  make_keystore(keys);
  for (const std::string& agent : options.agents)
    for (const std::string& middleware : options.middlewares) {
      std::vector<Layout> layouts(2, {middleware + ", open", middleware, agent, options.steps, 1, 8});
      layouts[1].figure = middleware + ", secured";
      layouts[1].keys = keys;
      compare(layouts, options.rounds);
    }
}

/// Adds the options that all trainings have.
Measure add_trainings(CLI::App& command, Options defaults, void (*measure)(const Options&)) {
  const auto options = std::make_shared<Options>(std::move(defaults));
  const auto positive = CLI::Range(1, 1000000000);
  command.add_option("steps,--steps", options->steps, "environment steps of each training")->check(positive);
  command.add_option("--rounds", options->rounds, "of which medians are printed")->check(positive);
  command.add_option("--agent", options->agents, "networks");
  command.add_option("--middleware", options->middlewares, "cyclonedds, fastdds");
  if (measure == compare_loops) command.add_option("--math", options->math, "library that multiplies matrices");
  if (measure != compare_services) return [=] { measure(*options); };
  command.add_option("--services", options->services, "env_services; as many agents in all")->check(CLI::Range(2, 64));
  command.add_option("--policy", options->policy, "further options of the policy_service")->allow_extra_args();
  return [=] { measure(*options); };
}

}  // namespace

Measure loop(CLI::App& command) {
  return add_trainings(command, {.middlewares = {"cyclonedds", "fastdds"}, .steps = 120000}, compare_loops);
}

Measure roles(CLI::App& command) { return add_trainings(command, {}, compare_roles); }

Measure security(CLI::App& command) {
  return add_trainings(
      command, {.agents = {"place_filter"}, .middlewares = {"cyclonedds", "fastdds"}, .steps = 40960, .rounds = 3},
      compare_secured);
}

Measure services(CLI::App& command) {
  return add_trainings(command,
                       {.agents = {"features", "place_filter"}, .middlewares = {"cyclonedds", "fastdds"}, .rounds = 5},
                       compare_services);
}

}  // namespace citylearn::bench
