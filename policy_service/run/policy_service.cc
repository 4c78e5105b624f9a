// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/policy_service.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <thread>

#include "core/files/files.h"
#include "core/util/machine.h"
#include "core/wire/service.h"
#include "policy_service/distributed/actor.h"
#include "policy_service/distributed/final_status_guard.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/network/layers/product.h"
#include "policy_service/ranks/launcher.h"
#include "policy_service/records/configuration.h"
#include "policy_service/results/verdict.h"
#include "policy_service/rollout/control.h"
#include "policy_service/run/training_run.h"

namespace citylearn {

int run_policy_service(const PolicyServiceOptions& options, Node& node, EnvClient& client) {
  RunContext context(options, node, client);
  EvaluationRun evaluation(context);
  std::unique_ptr<TrainingRun> training;
  try {
    if (options.mode == "train") {
      if (options.role == "learner")
        training = std::make_unique<LearnerRun>(context, evaluation);
      else
        training = std::make_unique<LocalTrainingRun>(context, evaluation);
      training->execute();
    } else {
      if (!options.checkpoint.empty()) evaluation.load_agent();
      context.require(evaluation.feature_dimension(), evaluation.data());
    }
    evaluation.evaluate_all();
  } catch (const StopRequested&) {
    context.progress.finish();
    std::string next;
    if (training && !options.output.empty())
      next = training->saved() ? fmt::format("; --resume continues after update {}", *training->saved())
                               : "; there is no checkpoint yet to resume from";
    spdlog::info("stopped by a signal{}", next);
    return 130;
  }
  context.records.require_all_written();
  if (!options.output.empty())
    write_file(options.output + "/summary.json",
               summary_json(context.options, training ? &training->report() : nullptr, evaluation.rows()));
  std::vector<ScoreRow> rows = evaluation.rows();
  VerdictOptions known = {.trained_on = training ? options.train : evaluation.data().names(),
                          .pairings = evaluation.pairings(),
                          .unchecked = !options.checkpoint.empty() && !evaluation.data().known()};
  take_world(rows, known);
  const bool compares =
      std::any_of(rows.begin(), rows.end(), [&](const ScoreRow& row) { return row.policy != rows.front().policy; });
  std::cout << (compares ? spl_matrix(context.options.agent, rows) : table(rows))
            << (known.world.empty()
                    ? ""
                    : "All of it is imperfect: " + known.world + " (docs/how-to/try-an-imperfect-world.md).\n")
            << verdict(context.options.agent, rows, known) << std::flush;
  if (!options.output.empty()) spdlog::info("wrote {}/summary.json", options.output);
  context.leave();
  return 0;
}

PolicyServiceOptions checked_options(PolicyServiceOptions options) {
  number_ranks(options);
  options.cap_steps = options.max_steps == 0;
  if (options.cap_steps) options.max_steps = options.frames;
  if (!std::isfinite(options.goal_radius)) throw Error("is not finite", "--goal-radius");
  if (options.goal_radius > 0 && options.role != "both")
    throw Error("is for --role both", "--goal-radius", "an actor does not learn of it");
  if (std::find(options.controls.begin(), options.controls.end(), "all") != options.controls.end()) {
    options.controls = {"shuffled"};
    for (const auto* entry : ControlRegistry::instance().entries()) options.controls.push_back(entry->name);
  }
  if (!options.parameters.empty() && options.checkpoint.empty())
    throw Error("needs --checkpoint", "--parameters", "name the checkpoint of the agent that they are for");
  for (const std::string& name : options.controls)
    if (name != "shuffled") ControlRegistry::instance().find("control", name);
  if (options.mode != "train" && (!options.initial_checkpoint.empty() || !options.frozen.empty()))
    throw Error("is for --mode train", options.initial_checkpoint.empty() ? "--freeze" : "--initial");
  const auto has_empty = [](const auto& names) { return std::find(names.begin(), names.end(), "") != names.end(); };
  if (options.train.empty() || has_empty(options.train)) throw Error("names no traversal", "--train");
  if (has_empty(options.evaluate)) throw Error("names no traversal", "--evaluate");
  for (auto name = options.train.begin(); name != options.train.end(); ++name)
    if (std::find(options.train.begin(), name, *name) != name) throw Error("names '" + *name + "' twice", "--train");
  if (options.role != "both" && options.train.size() > 1)
    throw Error("learns from one traversal, not from " + joined(options.train), "--role " + options.role,
                "train on several with --role both");
  if (std::isnan(options.stop_when)) throw Error("is not a number", "--stop-when");
  if (options.overwrite && options.output.empty()) throw Error("needs --output", "--overwrite");
  if (options.role != "both" && options.mode != "train") throw Error("is for --role both", "--mode " + options.mode);
  if (options.role == "learner" && options.lockstep)
    throw Error("is for --role both", "--lockstep", "what a learner gets when depends on its actors");
  if (options.mode == "train") {
    NetworkRegistry<float>::instance().find("agent", options.agent);
    LearnerRegistry::instance().find("learner", options.learner);
    if (!options.checkpoint.empty())
      throw Error("not for --mode train", "--checkpoint",
                  "to go on training use --resume, to train its agent on another route --initial");
    if (options.resume && options.output.empty()) throw Error("needs --output", "--resume");
  } else if (options.checkpoint.empty()) {
    ControlRegistry::instance().find("control", options.agent);
  }
  for (const std::string& path : {options.checkpoint, options.resume ? "" : options.initial_checkpoint})
    if (!path.empty()) read_checkpoint(path);  // before anything of an earlier run is replaced
  if (!options.configuration.empty()) options.configuration = effective_configuration(options, options.configuration);
  return options;
}

int run_policy_service(const PolicyServiceOptions& options) {
  const PolicyServiceOptions complete = checked_options(options);
  std::jthread preparation;  // while the services find each other
  if (!Machine::simulated()) preparation = std::jthread(prepare_math);
  if (complete.role == "actor") return run_actor({complete.node, complete.stay, complete.threads});
  Node node(complete.node);
  const FinalStatusGuard final_status(node);
  EnvClient client(node, complete.client);
  return run_policy_service(complete, node, client);
}

}  // namespace citylearn
