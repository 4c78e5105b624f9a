// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <iostream>
#include <limits>

#include "core/command_line/range_option.h"
#include "core/plugin/plugins.h"
#include "core/util/machine.h"
#include "core/util/name.h"
#include "core/wire/service.h"
#include "policy_service/interchange/export.h"
#include "policy_service/interchange/onnx_graph.h"
#include "policy_service/learning/learner.h"
#include "policy_service/learning/trainer.h"
#include "policy_service/learning/trainer_parameters.h"
#include "policy_service/network/agent_network.h"
#include "policy_service/network/product.h"
#include "policy_service/records/configuration.h"
#include "policy_service/records/demo_command.h"
#include "policy_service/results/comparison.h"
#include "policy_service/rollout/control.h"
#include "policy_service/run/policy_service.h"
#include "policy_service/run/sweep.h"

namespace {

using namespace citylearn;

constexpr int kMostFrames = 100000;

std::vector<ParameterSpec> trainer_parameters() { return mark_recommended(Trainer::parameter_specs(), ""); }

void print_list() {
  std::cout
      << "Networks (--agent), with the values of --LEARNER-X and --trainer-X that each recommends; relabel.X: for "
         "relabel alone\n";
  for (const auto* entry : NetworkRegistry<float>::instance().entries())
    std::cout << describe(entry->name, entry->help, entry->parameters, entry->name)
              << recommendation_text(entry->recommended);
  std::cout << "\nLearners (--learner):\n";
  for (const auto* entry : LearnerRegistry::instance().entries())
    std::cout << describe(entry->name, entry->help, mark_recommended(entry->parameters, entry->name), entry->name);
  std::cout << "\nTraining, whatever the learner:\n"
            << describe("trainer", "collects what is learned from", trainer_parameters(), "trainer");
  std::cout << "\nControls (--controls, or --agent with --mode evaluate):\n";
  for (const auto* entry : ControlRegistry::instance().entries())
    std::cout << describe(entry->name, entry->help, entry->parameters, entry->name);
  std::cout << describe("shuffled", "the agent itself on shuffled frames (--controls only)", {}, "");
  std::cout << "\nMiddlewares (--middleware):\n";
  for (const auto& [name, help] : list_middlewares()) std::cout << describe(name, help, {}, "");
}

/// Returns a check for `least` or more, 0 or 1. CLI11's own one names a range that ends with 309 digits.
CLI::Validator at_least(int least) {
  const std::string wanted = "must be " + std::to_string(least) + " or more";
  return {[=](const std::string& text) {
            double value = 0;
            return CLI::detail::lexical_cast(text, value) && value >= least ? "" : "'" + text + "' " + wanted;
          },
          least == 0 ? "NONNEGATIVE" : "POSITIVE"};
}

}  // namespace

int main(int argc, char** argv) {
  PolicyServiceOptions options;
  options.node.service = "policy_service";
  options.cap_frames = true;  // until --frames is given
  options.rank = -1;          // until --rank is given
  const std::string id = "policy";
  options.node.id = id;
  std::map<std::string, std::map<std::string, double>> plugins;  // given parameters, by plug-in
  bool list = false, agents = false, show_config = false;
  std::string demo;  // folder of a demo
  const CLI::App* parsed = nullptr;
  std::vector<std::uint64_t> seeds;  // of a sweep
  std::vector<std::string> runs;     // of a table

  const auto setup = [&](CLI::App& app) {
    parsed = &app;
    add_plugin_option(app, argc, argv);
    app.add_flag("--list", list, "Print networks, learners, controls and middlewares with their parameters, and exit");
    app.add_flag("--show-config", show_config,
                 "Print the value of each option that takes effect and where it comes from, and exit");
    app.add_flag("--recommended-agents", agents, "Print the number of agents that --agent trains best with, and exit");
    // How the command `demo` keeps its own words in manifest.json, and `again` finds them.
    app.add_option_function<std::string>("--demo-command",
                                         [&](const std::string& file) { options.demo_command = read_words(file); })
        ->group("");
    app.add_option("--print-demo-command", demo)->group("");
    app.add_option("--mode", options.mode,
                   "train (and evaluate at the end); evaluate; export --checkpoint to --output FILE.onnx (opset " +
                       std::to_string(OnnxGraph::kOpset) +
                       ", open batch) or FILE.safetensors; or table: compare RUNS that ended")
        ->capture_default_str()
        ->check(CLI::IsMember({"train", "evaluate", "export", "table"}));
    app.add_option("runs", runs, "With --mode table: folders with summary.json or sweep.json");
    app.add_option("--role", options.role,
                   "both: act and learn; learner: learn from what actors send; actor: act for the run's learner, which "
                   "sets all "
                   "other training options")
        ->capture_default_str()
        ->check(CLI::IsMember({"both", "actor", "learner"}));
    app.add_option("--agent", options.agent, "Network to train; with --mode evaluate and no --checkpoint, a control")
        ->capture_default_str();
    app.add_option("--learner", options.learner, "Learner")->capture_default_str();
    app.add_option("--checkpoint", options.checkpoint, "File to act from (--mode evaluate) or to export");
    app.add_option("--parameters", options.parameters,
                   "Safetensors file whose parameters replace those of --checkpoint");
    auto* resume = app.add_flag("--resume", options.resume,
                                "Continue from the newest checkpoint in --output; start anew where there is none");
    app.add_flag("--overwrite", options.overwrite,
                 "Replace an earlier run in --output; evaluations replace its summary.json and episodes.csv alone")
        ->excludes(resume);
    app.add_option("--initial", options.initial_checkpoint,
                   "Checkpoint whose agent's parameters training starts from, of any route (--mode train)")
        ->type_name("FILE");
    app.add_option("--freeze", options.frozen,
                   "Tensors that are not trained, A,B,...: lstm.input; or prefixes of names: lstm,heads")
        ->delimiter(',');
    auto* seed = app.add_option("--seed", options.seed, "Seed of all random numbers")->capture_default_str();
    app.add_option_function<std::string>(
           "--seeds",
           [&seeds](const std::string& text) {
             try {
               seeds = parse_seeds(text);
             } catch (const Error& error) {
               throw CLI::ValidationError("--seeds", error.what());
             }
           },
           "Train once for each: 1..5 or 1,3,7, in OUTPUT/seed-1 ..., then compare: OUTPUT/sweep.json and a table")
        ->excludes(seed);
    app.add_option("--output", options.output,
                   "Folder for summary.json, metrics.csv, episodes.csv, manifest.json, checkpoints/ and tensorboard/; "
                   "empty: nothing is written. With --mode export the file to write");

    app.add_option("--threads", options.threads,
                   "Threads that act in training and learn; by default all processors that this process may use. They "
                   "change no result. Learning uses as many as --ppo-shards, acting one for each 16 agents of an "
                   "env_service, at least two")
        ->default_str("processors")
        ->check(CLI::Range(1, 1024));
    app.add_option_function<std::string>(
           "--math", set_math,
           "Library that multiplies the networks' matrices. With another one the same seed gives slightly other "
           "results")
        ->default_str("onednn")
        ->check(CLI::IsMember(std::vector<std::string>(kMathNames.begin(), kMathNames.end())));

    app.option_defaults()->group("Task");
    // env_services announce recordings under such names.
    app.add_option(
           "--train", options.train,
           "Traversal to learn from; A,B,... are experiences of one route, which frames of A define: agents learn "
           "from all of them, and filters remember each")
        ->default_str("summer")
        ->delimiter(',')
        ->transform(name_from);
    app.add_option("--evaluate", options.evaluate, "Traversals to evaluate on, A,B,...")
        ->default_str("all that are found")
        ->delimiter(',')
        ->transform(name_from);
    app.add_option_function<std::string>(
           "--frames",
           [&options](const std::string& text) {
             constexpr int kOpen = std::numeric_limits<int>::max();
             int first = 0, end = kOpen;
             read_range("--frames", text, first, end);
             options.cap_frames = end == kOpen;
             if (options.cap_frames) end = kMostFrames;
             if (first < 0 || end - first < 2 || end > kMostFrames)
               throw CLI::ValidationError(
                   "--frames", "'" + text + "' must be two frames or more of 0:" + std::to_string(kMostFrames));
             options.first_frame = first;
             options.frames = end - first;
           },
           "Frames of the traversal that are the route's places, END not included; either may be left out; the "
           "default is lower on shorter traversals")
        ->type_name("FIRST:END")
        ->default_str("0:128");
    app.add_option("--max-steps", options.max_steps, "Step limit of an episode; 0 = N")
        ->capture_default_str()
        ->check(at_least(0));
    app.add_flag("--curriculum", options.curriculum, "Train through the paper's lessons: 4, 8, 16 ... N frames");
    app.add_option("--environments", options.environments, "env_services on each training traversal to start with")
        ->capture_default_str()
        ->check(CLI::Range(1, 1000));
    app.add_flag("--lockstep", options.lockstep,
                 "Wait for a lost training env_service instead of continuing without it");
    app.add_option(
           "--observations", options.client.observing,
           "whole: with features; by_reference: frames by name, their features are fetched once before; as_fits: "
           "whole where the env_service has the features and they fit one datagram")
        ->default_str("as_fits")
        ->transform(CLI::CheckedTransformer(std::map<std::string, Observing>{{"as_fits", Observing::kAsFits},
                                                                             {"whole", Observing::kWhole},
                                                                             {"by_reference", Observing::kByReference}},
                                            CLI::ignore_case));
    app.add_option("--wait", options.wait, "Seconds to wait for env_services before failing; 0 = forever")
        ->capture_default_str()
        ->check(at_least(0));

    app.option_defaults()->group("Roles");
    app.add_option("--window", options.window,
                   "Learner: unacknowledged segments of one env_service after which an actor waits")
        ->capture_default_str()
        ->check(CLI::Range(1, 1000));
    app.add_option("--max-lag", options.max_lag,
                   "Learner: drop trajectories of parameters older than so many updates; 0 = none")
        ->capture_default_str();
    app.add_flag("--stay", options.stay, "Actor: after a learner finishes, wait for the next");

    app.option_defaults()->group("Ranks");
    app.add_option("--rendezvous", options.rendezvous,
                   "Share the learning with other policy_services, each a rank in a DDS domain of its own: once an "
                   "update their parameters and Adam's moments are averaged. HOST:PORT where they meet, free on rank "
                   "0's host. The lowest rank that lives writes checkpoints; each has an --output of its own")
        ->type_name("HOST:PORT");
    app.add_option("--ranks", options.ranks,
                   "How many there are at the start; unless given, as OMPI_COMM_WORLD_SIZE, PMI_SIZE or SLURM_NTASKS "
                   "says")
        ->check(CLI::Range(1, 1000));
    app.add_option("--rank", options.rank,
                   "This one's number, from 0; unless given, as OMPI_COMM_WORLD_RANK, PMI_RANK or SLURM_PROCID says")
        ->check(CLI::Range(0, 999));
    app.add_option("--sync", options.sync,
                   "update: average parameters and Adam's moments once an update, weighted by steps; step: average "
                   "gradients at each step of Adam, which learns as one learner with all minibatches and needs a "
                   "quicker network")
        ->capture_default_str()
        ->check(CLI::IsMember({"update", "step"}));
    app.add_option("--rendezvous-wait", options.rendezvous_wait, "Seconds until ranks that do not come are an error")
        ->capture_default_str()
        ->check(at_least(1));

    app.option_defaults()->group("Length");
    app.add_option("--steps", options.steps,
                   "Environment steps to learn from; 0: what the agent recommends, see --show-config")
        ->capture_default_str();
    app.add_option("--time-limit", options.time_limit,
                   "End training after so many seconds; schedules such as the learning rate finish by then; 0 = never")
        ->capture_default_str()
        ->check(at_least(0));
    app.add_option("--stop-when", options.stop_when,
                   "End training when the mean SPL of the last 100 training episodes is at least this; 0 = never")
        ->capture_default_str()
        ->check(CLI::Range(0.0, 1.0));
    app.add_option("--checkpoint-every", options.checkpoint_every, "Updates between checkpoints")
        ->capture_default_str()
        ->check(at_least(1));
    app.add_option("--evaluate-every", options.evaluate_every,
                   "Updates between evaluations on the other traversals, whose mean SPL then decides which checkpoint "
                   "is best.clk; "
                   "0 = at the end only")
        ->capture_default_str()
        ->check(at_least(0));
    app.add_option("--tasks", options.tasks, "Evaluation tasks on each traversal")
        ->capture_default_str()
        ->check(CLI::Range(1, 1000000));
    app.add_option("--controls", options.controls,
                   "Controls evaluated on the same tasks: all, or some of shuffled, " +
                       joined(ControlRegistry::instance().entries(), &ControlRegistry::Entry::name))
        ->delimiter(',');

    add_node_options(app, options.node);
    add_metrics_option(app, options.node);
    for (const auto* entry : NetworkRegistry<float>::instance().entries())
      add_parameters(app, entry->name, entry->parameters, plugins[entry->name]);
    for (const auto* entry : LearnerRegistry::instance().entries())
      add_parameters(app, entry->name, mark_recommended(entry->parameters, entry->name), plugins[entry->name]);
    for (const auto* entry : ControlRegistry::instance().entries())
      add_parameters(app, entry->name, entry->parameters, plugins[entry->name]);
    add_parameters(app, "trainer", trainer_parameters(), plugins["trainer"]);
  };

  const auto body = [&] {
    if (list) {
      print_list();
      return 0;
    }
    if (!demo.empty()) {
      for (const std::string& word : demo_command_of(demo)) std::cout << word << '\0';
      return 0;
    }
    if (!runs.empty() && options.mode != "table") throw Error("is for --mode table alone", runs.front());
    if (agents) {
      std::cout << Trainer::recommended_parameters(options.agent, options.learner).at("trainer").at("agents") << "\n";
      return 0;
    }
    if (options.mode == "table") {
      std::cout << tables_of(runs);
      return 0;
    }
    if (options.mode == "export") {
      export_agent({options.checkpoint, options.parameters, options.output});
      return 0;
    }
    options.network_parameters = plugins[options.agent];
    options.learner_parameters = plugins[options.learner];
    options.trainer_parameters = plugins["trainer"];
    options.control_parameters = plugins;
    if (options.role == "actor" && options.node.id == id) options.node.id.clear();  // one of its own
    options.configuration = option_values(*parsed, argc, argv);
    // The folders of a simulated machine have other names in each run, which must be the same to the last byte.
    if (!Machine::simulated()) options.command.assign(argv, argv + argc);
    if (show_config) {
      std::cout << configuration_text(checked_options(options).configuration);
      return 0;
    }
    return seeds.empty() ? run_policy_service(options) : run_sweep(options, seeds);
  };
  return service_main(argc, argv, "Trains and evaluates navigation agents on the env_services of its run.", setup,
                      body);
}
