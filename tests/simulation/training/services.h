// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "env_service/traversal/traversal.h"
#include "tests/simulation/machine/process.h"
#include "tests/simulation/training/layout.h"

namespace citylearn::simulation {

/// The services and tools as main programs of simulated processes. Their folders and files lie in the current folder.

inline constexpr const char* kPolicy = "policy";          ///< id of the one that learns, and its folder
inline constexpr const char* kReplayed = "replayed";      ///< session of what is replayed
inline constexpr const char* kRecordings = "recordings";  ///< folder
inline constexpr const char* kViewer = "viewer";          ///< id of the dashboard that recordings are replayed to

/// Returns the traversal of all env_services.
Traversal traversal_of(const Layout& layout);

/// A service of a layout.
struct Service {
  std::string id;
  Process::Body body;
};
std::vector<Service> dashboards_of(const Layout& layout);
/// They keep episodes for the policy_service and the dashboards from the start. `traversal` must outlive them.
std::vector<Service> env_services_of(const Layout& layout, const Traversal& traversal);
std::vector<Service> actors_of(const Layout& layout);
std::vector<Service> encoder_services_of(const Layout& layout);
/// Acts and learns, or learns from actors.
Process::Body policy_service(const Layout& layout, int checkpoint_every);
/// A dashboard without a page, which stores in `id`.db.
Process::Body dashboard(const std::string& id, const std::string& session);
/// ./run record: each start writes a file of its own, as `record` never replaces one.
Process::Body record_tool();
/// ./run replay: plays all recordings.
Process::Body replay_tool();

/// Returns the recordings, in the order in which they were begun.
std::vector<std::string> recordings();

}  // namespace citylearn::simulation
