// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "core/util/file_lock.h"
#include "policy_service/records/policy_service_options.h"

namespace citylearn {

/// The folder that a run, or a sweep of several, writes to. No other process writes there while this lives.
class OutputFolder {
 public:
  /// Creates and locks the folder; does nothing when its name is empty. Throws Error naming it when another process has
  /// it.
  explicit OutputFolder(const std::string& folder);

 private:
  std::optional<FileLock> lock_;
};

/// Throws Error naming a file of an earlier run in options.output that the options neither continue nor replace.
void require_no_other_run(const PolicyServiceOptions& options);

/// Prepares a locked options.output for a run: removes what --overwrite replaces, and what a killed process left
/// half-written. Throws as require_no_other_run(), before anything has changed.
void prepare_output(const PolicyServiceOptions& options);

}  // namespace citylearn
