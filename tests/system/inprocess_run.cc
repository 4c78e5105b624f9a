// SPDX-License-Identifier: Apache-2.0
// One env_service and one policy_service in one process over the inprocess middleware, with the options of the lockstep
// test: the reference that every vendor's run must equal byte for byte.
#include <atomic>
#include <iostream>
#include <thread>

#include "env_service/dataset_io/dataset.h"
#include "env_service/env_service.h"
#include "policy_service/run/policy_service.h"

int main(int argc, char** argv) {
  using namespace citylearn;
  if (argc != 2) {
    std::cerr << "usage: inprocess_run OUTPUT\n";
    return 2;
  }
  try {
    const auto& entry = DatasetRegistry::instance().find("dataset", "synthetic");
    const Traversal summer =
        entry.create(Parameters("synthetic", entry.parameters, {{"frames", 160}, {"images", 0}}), "")->load("summer");
    EnvServiceOptions environment;
    environment.agents = 8;
    environment.node.middleware.name = "inprocess";
    std::atomic<bool> stop = false;
    std::thread host([&] { run_env_service(environment, summer, [&] { return stop.load(); }); });

    PolicyServiceOptions policy;
    policy.node.middleware.name = "inprocess";
    policy.node.service = "policy_service";
    policy.node.id = "policy";
    policy.agent = "place_filter";
    policy.steps = 50 * 512;
    policy.checkpoint_every = 20;
    policy.tasks = 16;
    policy.evaluate = {"summer"};
    policy.lockstep = true;
    policy.seed = 5;
    policy.wait = 60;
    policy.output = argv[1];
    const int status = run_policy_service(policy);
    stop = true;
    host.join();
    return status;
  } catch (const Error& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
