// SPDX-License-Identifier: Apache-2.0
// How fast, and how well, does an agent learn with nothing between environment and trainer? (README.md)
#include "tools/lab/training.h"

#include <malloc.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/bench.h"
#include "bench/made_up.h"
#include "bench/parameters.h"
#include "core/plugin/plugins.h"
#include "env_service/dataset_io/dataset.h"
#include "policy_service/network/checkpoint.h"
#include "policy_service/network/product.h"
#include "policy_service/rollout/network_policy.h"
#include "policy_service/rollout/worker_pool.h"
#include "tools/lab/descriptors.h"

namespace citylearn {
namespace {

struct Options {
  TrainerOptions trainer;
  std::string dataset = "plain", data, encoder, train = "summer";
  std::vector<std::string> evaluate = {"summer", "fall"};
  std::vector<std::string> set;  ///< name=value, of network, learner or trainer
  int frames = 128, environments = 1, agents = 0, tasks = 2000, evaluate_every = 0, print_every = 10;
  double time_limit = 0;
  bool shuffled = false, products = false, updates = false, places = false;
  std::string save;
};

Score evaluate(const TrainedAgent& agent, const Traversal& traversal, const Options& options, bool shuffle) {
  NetworkPolicy policy(agent, {});
  Trial trial;
  trial.first_frame = options.trainer.first_frame;
  trial.frames = trial.max_steps = options.frames;
  trial.tasks = options.tasks;
  trial.shuffle = shuffle;
  return score(try_out(policy, traversal, trial));
}

void print_evaluation(const TrainedAgent& agent, const std::vector<Traversal>& traversals, const Options& options) {
  for (const Traversal& traversal : traversals)
    for (const bool shuffle : {false, true}) {
      if (shuffle && !options.shuffled) continue;
      const Score f = evaluate(agent, traversal, options, shuffle);
      std::printf("  %-8s%-9s completed %.4f  SPL %.4f  steps %5.1f  reward %.4f\n", traversal.name.c_str(),
                  shuffle ? " shuffled" : "", f.completed, f.spl, f.mean_steps, f.reward);
    }
  std::fflush(stdout);
}

void train(const Options& options) {
  const auto dataset = DatasetRegistry::instance().find("dataset", options.dataset);
  const std::map<std::string, double> features = options.dataset == "synthetic" && options.encoder.empty()
                                                     ? std::map<std::string, double>{{"images", 0}}
                                                     : std::map<std::string, double>{};
  const auto source = dataset.create(Parameters("dataset", dataset.parameters, features), options.data);
  Traversal route = source->load(options.train);
  std::vector<Traversal> others;
  for (const std::string& name : options.evaluate) others.push_back(source->load(name));
  if (!options.encoder.empty()) {
    const auto& entry = EncoderRegistry::instance().find("encoder", options.encoder);
    const auto encoder = entry.create(Parameters("encoder " + options.encoder, entry.parameters, {}), {});
    const auto encode = [&](Traversal& traversal) {
      if (!traversal.images)
        throw Error("has no pictures", "traversal '" + traversal.name + "'", "leave --encoder out");
      traversal.frames = std::min(traversal.frames, options.trainer.first_frame + options.frames);
      if (&traversal == &route) lab::fit_encoder(*encoder, route);
      traversal = lab::with_features(traversal, lab::encode(*encoder, traversal, options.encoder, "").matrix);
    };
    encode(route);
    for (Traversal& other : others) encode(other);
  }

  InprocessTraining training(options.trainer, route, options.frames, {options.environments, options.agents});
  Trainer& trainer = training.trainer();
  for (const auto& [part, values] : trainer.parameters()) {
    std::printf("%s:", part.c_str());
    for (const auto& [name, value] : values) std::printf(" %s=%g", name.c_str(), value);
    std::printf("\n");
  }

  double wall_to_spl90 = 0, wall_to_spl95 = 0, judging = 0;
  const Clock::time_point start = Clock::now();
  while (!trainer.done() && (options.time_limit <= 0 || seconds_since(start) - judging < options.time_limit)) {
    const UpdateFigures figures = training.update();
    const TrainingProgress& progress = trainer.progress();
    if (progress.episodes >= 100 && progress.spl >= 0.9 && wall_to_spl90 == 0) {
      wall_to_spl90 = seconds_since(start) - judging;
      std::printf("SPL of the last 100 training episodes reached 0.90 after %llu episodes, %llu steps, %.1f s\n",
                  static_cast<unsigned long long>(progress.episodes), static_cast<unsigned long long>(progress.steps),
                  wall_to_spl90);
    }
    if (progress.episodes_to_spl95 && wall_to_spl95 == 0) wall_to_spl95 = seconds_since(start) - judging;
    if (progress.updates % static_cast<std::uint64_t>(options.print_every) == 0 || trainer.done()) {
      const double wall = seconds_since(start) - judging;
      std::printf(
          "%6.1f s  steps %8llu  episodes %6llu  lesson %d  reward %.3f  SPL %.3f | policy %+.4f value %.5f entropy "
          "%.3f "
          "KL %.4f clipped %.3f place %.3f way %.3f gradient %.3f | %.0f steps/s\n",
          wall, static_cast<unsigned long long>(progress.steps), static_cast<unsigned long long>(progress.episodes),
          progress.lesson, progress.reward, progress.spl, figures.policy_loss, figures.value_loss, figures.entropy,
          figures.approx_kl, figures.clip_fraction, figures.localisation_loss, figures.orientation_loss,
          figures.gradient_norm, static_cast<double>(progress.steps) / wall);
      std::fflush(stdout);
    }
    if (options.evaluate_every > 0 && progress.updates % static_cast<std::uint64_t>(options.evaluate_every) == 0) {
      const Clock::time_point pause = Clock::now();
      print_evaluation(trainer.agent(), others, options);
      judging += seconds_since(pause);
    }
  }
  const double wall = seconds_since(start) - judging;
  const TrainingProgress& progress = trainer.progress();
  std::printf(
      "trained %s, seed %llu: %llu steps, %llu episodes, %.1f s, %.0f steps/s; acting %.0f %%, learning %.0f %% of "
      "it\n",
      options.trainer.agent.c_str(), static_cast<unsigned long long>(options.trainer.seed),
      static_cast<unsigned long long>(progress.steps), static_cast<unsigned long long>(progress.episodes), wall,
      static_cast<double>(progress.steps) / wall, 100 * training.acting() / wall, 100 * training.learning() / wall);
  if (progress.episodes_to_spl95)
    std::printf("SPL of the last 100 training episodes reached 0.95 after %llu episodes, %llu steps, %.1f s\n",
                static_cast<unsigned long long>(*progress.episodes_to_spl95),
                static_cast<unsigned long long>(*progress.steps_to_spl95), wall_to_spl95);
  print_evaluation(trainer.agent(), others, options);
  if (!options.save.empty()) write_checkpoint(options.save, trainer.checkpoint());
}

/// Floating point operations per second of a product m x k times k x n by each library, and of a network's forward and
/// backward pass by the chosen one (the paper's sizes).
void products() {
  const auto rate = [](double operations, const auto& work) {
    work();
    const Clock::time_point start = Clock::now();
    int times = 0;
    do {
      work();
      ++times;
    } while (seconds_since(start) < 0.3);
    return operations * times / seconds_since(start) * 1e-9;
  };
  constexpr int kDimension = 64, kHidden = 512, kCells = 256;
  NetworkTask task;
  task.features = kDimension;
  const auto& entry = NetworkRegistry<float>::instance().find("network", "features");
  const auto network = entry.create(Parameters("features", entry.parameters, {}), task);
  Random random{1};
  Vector<float> parameters, gradient;
  network->initialise(random, parameters);
  gradient.setZero(parameters.size());
  const std::string chosen(name_of(used_math()));
  std::printf("%-22s %9s %9s %9s %9s   one thread, GFLOP/s\n", "", "eigen", "onednn", "forward", "backward");
  for (const auto& [steps, agents] : {std::array{1, 8}, std::array{1, 16}, std::array{1, 32}, std::array{64, 4},
                                      std::array{64, 8}, std::array{64, 16}}) {
    const int columns = steps * agents;
    const Matrix<float> weights = Matrix<float>::Random(4 * kCells, kHidden),
                        right = Matrix<float>::Random(kHidden, columns);
    Matrix<float> out(4 * kCells, columns);
    std::map<std::string, double> plain;
    for (const std::string library : {"eigen", "onednn"}) {
      set_math(library);
      plain[library] = rate(2.0 * 4 * kCells * kHidden * columns, [&] { set_product(out, weights, right); });
    }
    set_math(chosen);
    NetworkInputs<float> inputs;
    bench::make_up(inputs, task, steps, agents, random);
    const Matrix<float> state = Matrix<float>::Zero(network->state_size(), agents);
    const auto workspace = network->make_workspace();
    const double operations =
        2.0 * columns * (kHidden * (kDimension + 1) + 4 * kCells * (kHidden + 6) + 4 * kCells * kCells + 4 * kCells);
    const double best = std::max(plain["eigen"], plain["onednn"]);
    workspace->fixed = steps == 1 ? 1 : 0;  // as for acting
    const double forward = rate(operations, [&] { network->forward(parameters, inputs, state, *workspace); });
    std::printf("steps %3d, agents %3d   %9.1f %9.1f %9.1f ", steps, agents, plain["eigen"], plain["onednn"], forward);
    if (steps == 1) {
      std::printf("%9s   %.0f %% of the faster product\n", "", 100 * forward / best);
      continue;
    }
    Heads<float> derivative;
    derivative.logits.setRandom(kActions, columns);
    derivative.values.setRandom(1, columns);
    const double both = rate(operations, [&] {
      network->forward(parameters, inputs, state, *workspace);
      network->backward(parameters, inputs, *workspace, derivative, gradient);
    });
    const double backward = 2 / (1 / both - 1 / forward);  // twice the forward pass's operations
    std::printf("%9.1f   %.0f %%, %.0f %% of the faster product\n", backward, 100 * forward / best,
                100 * backward / best);
  }
}

/// The matrix products of one forward and backward pass of the paper's network over L steps of B sequences, with
/// nothing around them.
class BareProducts {
 public:
  BareProducts(int sensors, int hidden, int cells, int extra, int steps, int sequences)
      : steps_(steps), sequences_(sequences) {
    const int columns = steps * sequences, gates = 4 * cells;
    const auto random = [](int rows, int cols) { return Matrix<float>(Matrix<float>::Random(rows, cols)); };
    sensor_ = random(hidden, sensors), input_ = random(gates, hidden + extra), recurrent_ = random(gates, cells);
    back_ = random(cells, gates), head_ = random(kActions + 3, cells);
    sensed_ = random(sensors, columns), embedded_ = random(hidden + extra, columns), gates_ = random(gates, columns);
    h_ = random(cells, columns), out_ = random(kActions + 3, columns), hidden_ = random(hidden, columns);
  }
  void run() {
    set_product(hidden_, sensor_, sensed_);
    set_product(gates_, input_, embedded_);
    for (int t = 0; t < steps_; ++t) set_product(columns(gates_, t), recurrent_, columns(h_, t));
    set_product(out_, head_, h_);
    set_product(head_gradient_, out_, h_.transpose());
    set_product(h_gradient_, head_.transpose(), out_);
    for (int t = 1; t < steps_; ++t) set_product(carried_, back_, columns(gates_, t));
    set_product(recurrent_gradient_, gates_, h_.transpose());
    set_product(input_gradient_, gates_, embedded_.transpose());
    set_product(hidden_gradient_, input_.leftCols(hidden_.rows()).transpose(), gates_);
    set_product(sensor_gradient_, hidden_gradient_, sensed_.transpose());
  }

 private:
  Eigen::Block<Matrix<float>> columns(Matrix<float>& all, int t) {
    return all.block(0, t * sequences_, all.rows(), sequences_);
  }
  int steps_, sequences_;
  Matrix<float> sensor_, input_, recurrent_, back_, head_, sensed_, embedded_, gates_, h_, out_, hidden_;
  Matrix<float> head_gradient_, h_gradient_, carried_, recurrent_gradient_, input_gradient_, hidden_gradient_,
      sensor_gradient_;
};

/// Compares the time of a learner's update with that of its matrix products alone, both on two threads.
void updates(const Options& options) {
  constexpr int kDimension = 64, kAgents = 32, kSteps = 64;
  for (const int cells : {256, 64}) {
    NetworkTask task;
    task.features = kDimension;
    const auto& entry = NetworkRegistry<float>::instance().find("network", "features");
    const Parameters network_parameters("features", entry.parameters, {{"cells", cells}});
    const auto network = entry.create(network_parameters, task);
    std::map<std::string, double> values =
        Trainer::recommended_parameters("features", options.trainer.learner)["learner"];
    const auto& learner_entry = LearnerRegistry::instance().find("learner", options.trainer.learner);
    const Parameters parameters("learner", learner_entry.parameters, values);
    WorkerPool workers(2);
    const auto learner = learner_entry.create(
        parameters, LearnerTask{*network, "features", network_parameters, task, workers, 1, 1u << 30});

    Rollout rollout = bench::made_up_rollout(task, static_cast<int>(network->state_size()), kSteps, kAgents, kSteps);
    Rollout* const rollouts[] = {&rollout};
    const int epochs = static_cast<int>(values.at("epochs")), minibatch = static_cast<int>(values.at("minibatch"));
    std::vector<BareProducts> bare(2, {kDimension + 1, 512, cells, 2 * kActions, kSteps, minibatch / 2});
    const auto multiply = [&] {
      for (int i = 0; i < epochs * kAgents / minibatch; ++i)
        workers.run(2, [&](int which) { bare[static_cast<std::size_t>(which)].run(); });
    };
    double update = 0, product = 0;
    learner->update(rollouts);
    multiply();
    const Clock::time_point start = Clock::now();
    int times = 0;
    for (; seconds_since(start) < 5; ++times) {  // by turns, so that both meet the same machine
      Clock::time_point begin = Clock::now();
      learner->update(rollouts);
      update += seconds_since(begin);
      begin = Clock::now();
      multiply();
      product += seconds_since(begin);
    }
    std::printf(
        "features, %3d cells, %d epochs of minibatches of %d: update %.1f ms, its products alone %.1f ms, ratio %.2f; "
        "%.0f steps/s learned from\n",
        cells, epochs, minibatch, 1e3 * update / times, 1e3 * product / times, update / product,
        times * kSteps * kAgents / update);
  }
}

/// Time and memory of place_filter as the route grows: both should follow N.
void places() {
  constexpr int kDimension = 64, kSteps = 64, kAgents = 8;
  double first_time = 0, first_memory = 0;
  for (const int places : {128, 256, 512, 1024, 2048, 4096}) {
    NetworkTask task;
    task.features = kDimension;
    task.frames = places;
    task.reference = Matrix<float>::Random(kDimension, places).colwise().normalized();
    const auto& entry = NetworkRegistry<float>::instance().find("network", "place_filter");
    const std::size_t before = mallinfo2().uordblks + mallinfo2().hblkhd;
    const auto network = entry.create(Parameters("place_filter", entry.parameters, {}), task);
    Random random{1};
    Vector<float> parameters, gradient;
    network->initialise(random, parameters);
    gradient.setZero(parameters.size());
    NetworkInputs<float> inputs;
    bench::make_up(inputs, task, kSteps, kAgents, random);
    const Matrix<float> state = Matrix<float>::Zero(network->state_size(), kAgents);
    Heads<float> derivative;
    derivative.logits.setRandom(kActions, kSteps * kAgents);
    derivative.values.setRandom(1, kSteps * kAgents);
    const auto workspace = network->make_workspace();
    const auto pass = [&] {
      network->forward(parameters, inputs, state, *workspace);
      network->backward(parameters, inputs, *workspace, derivative, gradient);
    };
    pass();
    const double memory = static_cast<double>(mallinfo2().uordblks + mallinfo2().hblkhd - before);
    const Clock::time_point start = Clock::now();
    int times = 0;
    for (; seconds_since(start) < 0.5; ++times) pass();
    const double time = seconds_since(start) / times / (kSteps * kAgents);
    if (first_time == 0) first_time = time, first_memory = memory;
    const double growth = places / 128.0;
    std::printf(
        "N = %4d: %6.2f us a step forward and back, %6.2f MB; per place %.2f of the time and %.2f of the memory at N = "
        "128\n",
        places, 1e6 * time, 1e-6 * memory, time / first_time / growth, memory / first_memory / growth);
  }
}

void add_options(CLI::App& app, Options& options) {
  app.add_option("--agent", options.trainer.agent, "network")->capture_default_str();
  app.add_option("--learner", options.trainer.learner, "learner")->capture_default_str();
  app.add_option("--seed", options.trainer.seed, "")->capture_default_str();
  app.add_option("--threads", options.trainer.threads, "that act and learn; as many as processors unless given")
      ->check(CLI::Range(1, 1024));
  app.add_option_function<std::string>("--math", set_math, "library that multiplies matrices")
      ->default_str("onednn")
      ->check(CLI::IsMember(std::vector<std::string>(kMathNames.begin(), kMathNames.end())));
  app.add_option("--set", options.set, "name=value: a parameter of network, learner or trainer");
  app.add_flag("--curriculum", options.trainer.curriculum, "the paper's lessons");
  app.add_option("--dataset", options.dataset, "")->capture_default_str();
  app.add_option("--data", options.data, "folder of the dataset");
  app.add_option("--encoder", options.encoder, "encodes the dataset's pictures; none: its features");
  app.add_option("--train", options.train, "traversal")->capture_default_str();
  app.add_option("--evaluate", options.evaluate, "traversals");
  app.add_option("--first-frame", options.trainer.first_frame, "")->capture_default_str();
  app.add_option("--frames", options.frames, "N")->capture_default_str();
  app.add_option("--environments", options.environments, "")->check(CLI::Range(1, 64))->capture_default_str();
  app.add_option("--agents", options.agents, "of each environment; 0 = the network's recommendation in all");
  app.add_option("--tasks", options.tasks, "of each evaluation")->capture_default_str();
  app.add_option("--evaluate-every", options.evaluate_every, "updates; 0 = at the end");
  app.add_option("--print-every", options.print_every, "updates")->check(CLI::Range(1, 1000000))->capture_default_str();
  app.add_option("--time-limit", options.time_limit, "seconds of training; 0 = none");
  app.add_option("--save", options.save, "checkpoint to write at the end");
  app.add_flag("--shuffled", options.shuffled, "evaluate on shuffled frames too");
  app.add_flag("--updates", options.updates,
               "measure a learner's updates beside the bare products in them, train nothing");
  app.add_flag("--places", options.places, "measure place_filter on longer and longer routes, train nothing");
  app.add_flag("--products", options.products, "measure matrix products and the network's passes, train nothing");
}

void measure(Options options) {
  bench::give_parameters(options.set, options.trainer);
  if (options.places)
    places();
  else if (options.updates)
    updates(options);
  else if (options.products)
    products();
  else
    train(options);
}

}  // namespace
}  // namespace citylearn

int main(int argc, char** argv) {
  citylearn::Options options;
  CLI::App app("Trains and evaluates an agent in one process, without the wire", "bench_training");
  return citylearn::bench::run(
      app, argc, argv, [&] { citylearn::measure(options); },
      [&] {
        citylearn::add_plugin_option(app, argc, argv);
        citylearn::add_options(app, options);
      });
}
