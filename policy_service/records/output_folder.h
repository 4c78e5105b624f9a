// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/files/file_lock.h"
#include "policy_service/records/policy_service_options.h"

namespace citylearn {

/// The folder that a run, or a sweep of several, writes to. No other process writes there while this lives.
class OutputFolder {
 public:
  /// Creates and locks the folder; does nothing without a name. Throws Error naming it when another process has it.
  explicit OutputFolder(const std::string& folder);

 private:
  std::optional<FileLock> lock_;
};

/// Returns the names of what a run writes into its folder: files and folders.
std::vector<std::string> output_names(const PolicyServiceOptions& options);

/// Throws Error naming a file of an earlier run in options.output that the options neither continue nor replace.
void require_no_other_run(const PolicyServiceOptions& options);

/// Prepares a locked options.output for a run: removes what --overwrite replaces, and what a killed process left
/// half-written. Throws as require_no_other_run(), before anything has changed.
void prepare_output(const PolicyServiceOptions& options);

/// Returns the id of a run: with --resume that in its manifest.json, else a new one. A copy of a folder, and a folder
/// that a service of another id wrote, begin a run of their own, so that recorders keep it apart from the first one.
std::uint64_t run_id_for(const PolicyServiceOptions& options);

/// Returns the numbers of ranks of a run's earlier stretches, as its manifest.json has them, without repetitions of the
/// present one; empty where it is not resumed.
std::vector<int> earlier_ranks(const PolicyServiceOptions& options);

/// Returns what tells a folder from copies of it: its inode; 0 where there is none.
std::uint64_t folder_identity(const std::string& folder);

}  // namespace citylearn
