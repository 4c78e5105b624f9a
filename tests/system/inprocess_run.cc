// SPDX-License-Identifier: Apache-2.0
// One env_service and one policy_service in one process over the inprocess middleware, with the options of the lockstep
// test: the reference that every vendor's run must equal byte for byte.
#include <iostream>

#include "policy_service/run/policy_service.h"
#include "tests/support/env/env.h"
#include "tests/support/env/env_service_thread.h"

int main(int argc, char** argv) {
  using namespace citylearn;
  if (argc != 2) {
    std::cerr << "usage: inprocess_run OUTPUT\n";
    return 2;
  }
  try {
    EnvServiceOptions environment;
    environment.agents = 8;
    environment.node.middleware.name = "inprocess";
    const citylearn::testing::EnvServiceThread host(
        environment,
        citylearn::testing::make_dataset("synthetic", "", {{"frames", 160}, {"images", 0}})->load("summer"));

    PolicyServiceOptions policy;
    policy.node.middleware.name = "inprocess";
    policy.node.service = "policy_service";
    policy.node.id = "policy";
    policy.agent = "place_filter";
    policy.steps = 30 * 512;
    policy.checkpoint_every = 20;
    policy.tasks = 16;
    policy.evaluate = {"summer"};
    policy.lockstep = true;
    policy.seed = 5;
    policy.wait = 60;
    policy.output = argv[1];
    return run_policy_service(policy);
  } catch (const Error& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
