// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "trained_agent.h"

namespace citylearn {

/// Everything that a training run needs to continue, and that an agent needs to act. One file: magic, version, JSON
/// header, tensors (little-endian floats, column-major), SHA-256 of all that. The same contents give the same bytes.
struct Checkpoint {
  nlohmann::json header;                         ///< agent, parameters, task, counters ... (Trainer::checkpoint)
  std::map<std::string, Matrix<float>> tensors;  ///< "learner.parameters", "learner.adam.first", "reference" ...
};

/// Writes the whole file or leaves the one before (see write_file). Throws Error naming the file.
void write_checkpoint(const std::string& path, const Checkpoint& checkpoint);

/// Throws Error naming the file when it is not a checkpoint, is of a newer program, incomplete or damaged.
Checkpoint read_checkpoint(const std::string& path);

/// Writes `folder`/checkpoint-<update>.clk (making the folder), then removes all but the newest `keep`. Returns the
/// path. Throws Error naming the file; the old ones then all remain.
std::string write_checkpoint_of_update(const std::string& folder, std::uint64_t update, const Checkpoint& checkpoint,
                                       int keep = 3);

/// The file of a run's best checkpoint, beside the newest ones.
inline constexpr const char* kBestCheckpoint = "best.clk";

/// Returns the checkpoint of the latest update, or the best one where it is alone; none when the folder has none or
/// does not exist.
std::optional<std::string> newest_checkpoint(const std::string& folder);

}  // namespace citylearn
