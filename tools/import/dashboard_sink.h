// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "tools/import/log_writer.h"

namespace citylearn {

/// Sends the log of runs to a dashboard that runs: POST /api/runs/ID (docs/reference/dashboard-api.md, "Logged runs").
/// Used by one thread.
class DashboardSink {
 public:
  /// `url` is http://HOST:PORT or https://HOST:PORT, `token` empty where none is needed. Throws Error when it is
  /// neither.
  DashboardSink(const std::string& url, std::string token);
  ~DashboardSink();

  /// Sends a batch of points alone or of one other record, in as many requests as it takes. Throws Error, naming the
  /// dashboard, when it cannot be reached or refuses.
  LoggedRuns::Outcome append(const std::string& id, const LogBatch& batch);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
