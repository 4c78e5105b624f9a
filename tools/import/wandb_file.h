// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tools/import/event_files.h"

namespace citylearn {

/// Returns whether a file's name is that of a run that Weights & Biases recorded: run-ID.wandb.
bool is_wandb_file(const std::string& name);

/// Imports history, configuration and summary of an offline run of Weights & Biases: a log in LevelDB's format
/// (github.com/google/leveldb, doc/log_format.md, with zlib's CRC-32) of the messages of wandb_internal.proto. The
/// run's ID is PROJECT/RUN as the file says; `project` replaces its project unless it is empty. Numbers alone are
/// imported. Throws Error, naming the file, when it is not such a file, and when the sink does not take it.
ImportedRun import_wandb_file(const std::string& path, const std::string& project, const LogSink& sink);

}  // namespace citylearn
