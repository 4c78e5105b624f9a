// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "core/wire/service.h"
#include "policy_service/records/policy_service_options.h"

namespace citylearn {

/// Returns the options that take effect, each with the value that runs. `parsed` is what the command line says
/// (option_values()) and `options` what became of it (checked_options()). Values that the agent recommends have the
/// origin "recommended by AGENT". Left out are the parameters of plug-ins that this run does not use, all of them where
/// nothing is learned, and what only prints something. Throws Error naming an unknown plug-in or parameter.
std::vector<OptionValue> effective_configuration(const PolicyServiceOptions& options,
                                                 const std::vector<OptionValue>& parsed);

/// Returns the text of --show-config: a line for each option, in columns, "-" for no value.
std::string configuration_text(const std::vector<OptionValue>& configuration);

/// Returns what the run in `folder` ran with, as its manifest.json has it. Throws Error.
std::vector<OptionValue> recorded_configuration(const std::string& folder);

/// Returns a few lines for --list: what a network recommends, "relabel.epochs" for the learner relabel alone.
std::string recommendation_text(const std::map<std::string, double>& recommended);

}  // namespace citylearn
