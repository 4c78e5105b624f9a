// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <iostream>

#include "core/plugin/plugins.h"
#include "core/util/machine.h"
#include "core/wire/service.h"
#include "policy_service/learning/learner.h"
#include "policy_service/learning/trainer.h"
#include "policy_service/learning/trainer_parameters.h"
#include "policy_service/network/agent_network.h"
#include "policy_service/network/layers/product.h"
#include "policy_service/records/configuration.h"
#include "policy_service/results/comparison.h"
#include "policy_service/rollout/control.h"
#include "policy_service/run/policy_service.h"
#include "policy_service/run/run_options.h"
#include "policy_service/run/sweep.h"

namespace {

using namespace citylearn;

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

struct CommandLine {
  PolicyServiceOptions options;
  std::map<std::string, std::map<std::string, double>> plugins;  ///< given parameters, by plug-in
  bool list = false, show_config = false;
  std::vector<std::uint64_t> seeds;  ///< of a sweep
  std::vector<std::string> runs;     ///< of a table
  const CLI::App* parsed = nullptr;
};

const std::string kId = "policy";  // until --id is given

/// Adds what is trained or evaluated, and where the results go.
void add_run_options(CLI::App& app, CommandLine& line) {
  PolicyServiceOptions& options = line.options;
  app.add_flag("--list", line.list,
               "Print networks, learners, controls and middlewares with their parameters, and exit");
  app.add_flag("--show-config", line.show_config,
               "Print the value of each option that takes effect and where it comes from, and exit; with the folder "
               "of a run: what it ran with");
  app.add_option("--mode", options.mode, "train (and evaluate at the end); evaluate; or table: compare RUNS that ended")
      ->capture_default_str()
      ->check(CLI::IsMember({"train", "evaluate", "table"}));
  app.add_option("runs", line.runs,
                 "With --mode table: folders with summary.json or sweep.json; with --show-config: one");
  app.add_option("--role", options.role,
                 "both: act and learn; learner: learn from what actors send; actor: act for the run's learner, which "
                 "sets all other training options")
      ->capture_default_str()
      ->check(CLI::IsMember({"both", "actor", "learner"}));
  app.add_option("--agent", options.agent, "Network to train; with --mode evaluate and no --checkpoint, a control")
      ->capture_default_str();
  app.add_option("--learner", options.learner, "Learner")->capture_default_str();
  app.add_option("--checkpoint", options.checkpoint, "File to act from (--mode evaluate)");
  app.add_option("--parameters", options.parameters, "Safetensors file whose parameters replace those of --checkpoint");
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
         [&line](const std::string& text) {
           try {
             line.seeds = parse_seeds(text);
           } catch (const Error& error) {
             throw CLI::ValidationError("--seeds", error.what());
           }
         },
         "Train once for each: 1..5 or 1,3,7, in OUTPUT/seed-1 ..., then compare: OUTPUT/sweep.json and a table")
      ->excludes(seed);
  app.add_option("--output", options.output,
                 "Folder for summary.json, metrics.csv, episodes.csv, manifest.json, checkpoints/ and tensorboard/; "
                 "empty: nothing is written");

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
}

/// Adds the options of a training that several policy_services share.
void add_rank_options(CLI::App& app, PolicyServiceOptions& options) {
  options.rank = -1;  // until --rank is given
  app.option_defaults()->group("Ranks");
  app.add_option("--ranks-domain", options.ranks_domain,
                 "Share the learning with other policy_services, each a rank with a --domain or --session of its own: "
                 "once an update their parameters and Adam's moments are averaged. DDS domain in which the ranks of "
                 "this training meet, over --interface; --peers of each name the hosts of all. The lowest rank that "
                 "lives writes checkpoints; each has an --output of its own")
      ->check(CLI::Range(0, 232));
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
  app.add_option("--ranks-wait", options.ranks_wait, "Seconds until ranks that do not come are an error")
      ->capture_default_str()
      ->check(at_least(1));
  app.add_flag("--unprotected-sums", options.unprotected_sums,
               "Share the learning although --security does not cover the sums, which ranks add over TCP");
}

/// Adds the parameters of all plug-ins, and of the trainer.
void add_plugin_parameters(CLI::App& app, CommandLine& line) {
  for (const auto* entry : NetworkRegistry<float>::instance().entries())
    add_parameters(app, entry->name, entry->parameters, line.plugins[entry->name]);
  for (const auto* entry : LearnerRegistry::instance().entries())
    add_parameters(app, entry->name, mark_recommended(entry->parameters, entry->name), line.plugins[entry->name]);
  for (const auto* entry : ControlRegistry::instance().entries())
    add_parameters(app, entry->name, entry->parameters, line.plugins[entry->name]);
  add_parameters(app, "trainer", trainer_parameters(), line.plugins["trainer"]);
}

/// Does what the command line asks for. Returns the exit status.
int run(CommandLine& line, int argc, char** argv) {
  PolicyServiceOptions& options = line.options;
  if (line.list) {
    print_list();
    return 0;
  }
  if (line.show_config && line.runs.size() == 1) {
    std::cout << configuration_text(recorded_configuration(line.runs.front()));
    return 0;
  }
  if (!line.runs.empty() && options.mode != "table")
    throw Error("is read with --mode table, and alone with --show-config", line.runs.front());
  if (options.mode == "table") {
    std::cout << tables_of(line.runs);
    return 0;
  }
  options.network_parameters = line.plugins[options.agent];
  options.learner_parameters = line.plugins[options.learner];
  options.trainer_parameters = line.plugins["trainer"];
  options.control_parameters = line.plugins;
  if (options.role == "actor" && options.node.id == kId) options.node.id.clear();  // one of its own
  options.configuration = option_values(*line.parsed, argc, argv);
  // The folders of a simulated machine have other names in each run, which must be the same to the last byte.
  if (!Machine::simulated()) options.command.assign(argv, argv + argc);
  if (line.show_config) {
    std::cout << configuration_text(checked_options(options).configuration);
    return 0;
  }
  return line.seeds.empty() ? run_policy_service(options) : run_sweep(options, line.seeds);
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  PolicyServiceOptions& options = line.options;
  options.node.service = "policy_service";
  options.node.id = kId;
  const auto add_options = [&](CLI::App& app) {
    line.parsed = &app;
    add_plugin_option(app, argc, argv);
    add_run_options(app, line);

    app.option_defaults()->group("Task");
    add_task_options(app, options);

    app.option_defaults()->group("Roles");
    add_learner_options(app, options);
    app.add_flag("--stay", options.stay, "Actor: after a learner finishes, wait for the next");

    add_rank_options(app, options);

    app.option_defaults()->group("Length");
    add_length_options(app, options);

    add_node_options(app, options.node);
    add_metrics_option(app, options.node);
    add_memory_option(app);
    add_plugin_parameters(app, line);
  };
  return service_main(argc, argv, "Trains and evaluates navigation agents on the env_services of its run.", add_options,
                      [&] { return run(line, argc, argv); });
}
