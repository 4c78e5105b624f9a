// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/import/log_writer.h"

namespace citylearn {

/// Returns whether a file's name is that of a TensorBoard event file.
bool is_event_file(const std::string& name);

struct ImportedRun {
  std::string id;
  std::uint64_t points = 0;
  std::string problem;  ///< what is missing of the run, and why; empty: nothing
};

/// Imports the scalars and hyperparameters of one TensorBoard run: of its event files, which are all in one folder, in
/// the order of their names (tensorflow/core/util/event.proto, summary.proto; scalars as `simple_value` and as
/// tensors). `id` is the run's. Other kinds of summaries are left out. Throws Error when the sink does not take it.
ImportedRun import_event_files(const std::vector<std::string>& files, const std::string& id, const LogSink& sink);

}  // namespace citylearn
