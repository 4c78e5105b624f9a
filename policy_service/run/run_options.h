// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/run/policy_service.h"

namespace CLI {
class App;
class Validator;
}  // namespace CLI

namespace citylearn {

/// Add options of a policy_service that other programs have too. `options` must live until the command line is parsed.

/// --source.
void add_source_option(CLI::App& app, std::map<std::string, std::string>& source, const std::string& help);
/// --source, --train, --evaluate, --frames, --max-steps, --curriculum, --environments, --lockstep, --observations,
/// --wait.
void add_task_options(CLI::App& app, PolicyServiceOptions& options);
/// Adds the options of a learner with actors: --window, --max-lag.
void add_learner_options(CLI::App& app, PolicyServiceOptions& options);
/// --steps, --time-limit, --stop-when, --checkpoint-every, --evaluate-every, --tasks, --controls.
void add_length_options(CLI::App& app, PolicyServiceOptions& options);

/// Returns a check for `least` or more, 0 or 1. CLI11's own one names a range that ends with 309 digits.
CLI::Validator at_least(int least);

}  // namespace citylearn
