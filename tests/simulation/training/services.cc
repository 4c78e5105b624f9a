// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/training/services.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "core/recording/mcap.h"
#include "core/recording/replayer.h"
#include "dashboard/store/recorder.h"
#include "encoder_service/encoder_service.h"
#include "env_service/dataset_io/dataset.h"
#include "env_service/env_service.h"
#include "policy_service/run/policy_service.h"
#include "tests/support/records/record_until.h"
#include "tests/support/streets.h"
#include "tools/record/recording.h"

namespace citylearn::simulation {
namespace {

using Stop = std::function<bool()>;

constexpr int kFrames = 16;            // of the route
constexpr int kStoppedBySignal = 130;  // exit status

NodeOptions node_options(const std::string& service, const std::string& id) { return {{}, service, id, "default"}; }

/// Returns whether a recording can be replayed. One that lost its middle with the power cannot.
bool readable(const std::string& file) {
  try {
    McapReader reader(file);
    while (reader.next()) continue;
    return true;
  } catch (const Error&) {
    return false;
  }
}

Process::Body env_service(const std::string& id, const Layout& layout, const Traversal& traversal,
                          const std::vector<std::string>& recorders) {
  EnvServiceOptions options;
  options.goals = layout.goals;
  options.node.id = id;
  options.agents = layout.agents;
  options.recorders = recorders;
  return [options, &traversal](const Stop& stop) {
    run_env_service(options, traversal, stop);
    return 0;
  };
}

Process::Body actor(const std::string& id) {
  PolicyServiceOptions options;
  options.node = node_options("policy_service", id);
  options.role = "actor";
  options.stay = true;
  return [options](const Stop& stop) {
    const int status = run_policy_service(options);
    return status == kStoppedBySignal && stop() ? 0 : status;
  };
}

Process::Body encoder_service(const std::string& id) {
  EncoderServiceOptions options;
  options.node = node_options("encoder_service", id);
  options.encoder = "patchnorm";
  options.parameters = {{"width", 8}, {"height", 8}, {"patch", 4}};
  options.reduction.dimension = 8;
  options.store = "features";
  return [options](const Stop& stop) {
    run_encoder_service(options, stop);
    return 0;
  };
}

/// Returns "NAME-0", "NAME-1" ... with their main programs.
std::vector<Service> services_of(const std::string& name, int count,
                                 const std::function<Process::Body(const std::string& id)>& body) {
  std::vector<Service> services;
  for (int i = 0; i < count; ++i) {
    const std::string id = name + "-" + std::to_string(i);
    services.push_back({id, body(id)});
  }
  return services;
}

}  // namespace

Traversal traversal_of(const Layout& layout) {
  std::map<std::string, double> parameters{{"frames", 64}, {"images", 0}};
  if (layout.encoders > 0) parameters = {{"frames", 24}, {"images", 1}, {"width", 32}, {"height", 32}};
  const StreetMap streets = testing::small_streets();
  if (layout.streets) parameters["frames"] = static_cast<double>(streets.links());
  const auto& entry = DatasetRegistry::instance().find("dataset", "synthetic");
  Traversal traversal = entry.create(Parameters(entry.name, entry.parameters, parameters), "")->load("summer");
  if (layout.streets) {
    traversal.streets = std::make_shared<const StreetMap>(streets);
    traversal.rule = StateRule::kStreet;
    traversal.positions.assign(traversal.positions.size(), NAN);
  }
  return traversal;
}

std::vector<Service> dashboards_of(const Layout& layout) {
  std::vector<Service> dashboards;
  for (int i = 0; i < layout.dashboards; ++i) {
    const std::string id = i == 0 ? "recorder" : "recorder-" + std::to_string(i);
    dashboards.push_back({id, dashboard(id, "default")});
  }
  return dashboards;
}

std::vector<Service> env_services_of(const Layout& layout, const Traversal& traversal) {
  std::vector<std::string> recorders{kPolicy};
  for (const Service& dashboard : dashboards_of(layout)) recorders.push_back(dashboard.id);
  return services_of("env", layout.environments,
                     [&](const std::string& id) { return env_service(id, layout, traversal, recorders); });
}

std::vector<Service> actors_of(const Layout& layout) { return services_of("actor", layout.actors, actor); }

std::vector<Service> encoder_services_of(const Layout& layout) {
  return services_of("encoder", layout.encoders, encoder_service);
}

Process::Body policy_service(const Layout& layout, int checkpoint_every) {
  PolicyServiceOptions options;
  options.node = node_options("policy_service", kPolicy);
  options.agent = "place_filter";
  options.frames = kFrames;
  options.cap_frames = layout.streets;  // they are walked as a whole
  options.steps = layout.steps();
  options.checkpoint_every = checkpoint_every;
  options.tasks = 8;
  options.evaluate = {"summer"};
  options.environments = layout.environments;
  options.lockstep = layout.lockstep();
  options.seed = 5;
  options.resume = true;
  options.output = kPolicy;
  options.trainer_parameters["segment"] = layout.segment;
  options.trainer_parameters["sequence"] = layout.segment;
  if (!layout.lockstep()) {
    options.role = "learner";
    options.trainer_parameters["agents"] = layout.batch();
  }
  // Observations without features, for an encoder_service to complete.
  if (layout.encoders > 0) options.client.observing = Observing::kWhole;
  return [options](const Stop&) { return run_policy_service(options); };
}

Process::Body dashboard(const std::string& id, const std::string& session) {
  return [id, session](const Stop& stop) {
    Store store({id + ".db", 0});
    NodeOptions options = node_options("dashboard", id);
    options.session = session;
    Node node(options);
    Recorder recorder(node, store);
    node.report(msg::RUNNING, "records");
    testing::record_until(node, recorder, stop);
    return 0;
  };
}

Process::Body record_tool() {
  return [](const Stop& stop) {
    std::filesystem::create_directories(kRecordings);
    char name[32];
    std::snprintf(name, sizeof name, "%s/%04d.mcap", kRecordings, current_process()->starts());
    const std::unique_ptr<Middleware> middleware = create_middleware({});
    RecordingOptions options;
    options.output = name;
    options.session = "default";
    Recording recording(*middleware, options);
    while (!stop()) {
      middleware->wait(Clock::now() + std::chrono::milliseconds(100));
      recording.poll();
    }
    recording.close();
    return 0;
  };
}

Process::Body replay_tool() {
  return [](const Stop& stop) {
    ReplayOptions options;
    options.session = kReplayed;
    options.speed = 0;
    for (const std::string& file : recordings())
      if (readable(file)) options.files.push_back(file);
    if (options.files.empty()) return 0;
    const std::unique_ptr<Middleware> middleware = create_middleware({});
    Replayer replayer(*middleware, options);
    while (!stop() && replayer.poll()) middleware->wait(replayer.due());
    return 0;
  };
}

std::vector<std::string> recordings() {
  std::vector<std::string> files;
  if (std::filesystem::exists(kRecordings))
    for (const auto& entry : std::filesystem::directory_iterator(kRecordings)) files.push_back(entry.path().string());
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace citylearn::simulation
