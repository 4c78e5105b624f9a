// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/wire/node_options.h"
#include "env_service/imperfections.h"
#include "env_service/traversal/traversal.h"
#include "policy_service/network/checkpoint/training_data.h"

namespace citylearn::python {

/// Keyword arguments as text, named as the programs' options with '_' for '-': {"step_metres", "2"}.
using Keywords = std::map<std::string, std::string>;

/// A traversal with features, and what befalls agents on it.
struct Recording {
  Traversal traversal;
  Imperfections imperfections;
  int goals = 1;                   ///< of a task
  std::shared_ptr<Images> images;  ///< the traversal's pictures; null where it was recorded as features
};

/// Loads a traversal by the options of env_service and, for pictures, of encoder_service. An agent that learned from
/// `learned` sees it as it was taught: what `keywords` leave out is taken from there, and features are made by the same
/// encoder and reduction. Throws UnknownOption; Error naming option, file or frame, or what does not fit the agent.
Recording load_recording(const Keywords& keywords, const TrainingData& learned = {});

/// Reads the options that every service has (add_node_options). Throws UnknownOption or Error.
NodeOptions read_node_options(const Keywords& keywords);

/// Return the names that the first two know.
std::vector<std::string> recording_options();
std::vector<std::string> node_option_names();

}  // namespace citylearn::python
