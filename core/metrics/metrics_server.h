// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

namespace citylearn {

class Metrics;

/// Serves /metrics, /healthz and /livez over HTTP on one thread of its own. Each connection has a second and one
/// request; those beyond kConnections wait.
class MetricsServer {
 public:
  static constexpr int kConnections = 16;

  /// `address` is "[ADDRESS:]PORT". Throws Error when it cannot listen there.
  MetricsServer(const Metrics& metrics, const std::string& address);
  ~MetricsServer();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
