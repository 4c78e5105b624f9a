// SPDX-License-Identifier: Apache-2.0
#include "core/util/machine.h"

#include <unistd.h>

namespace citylearn {
namespace {

thread_local Machine* simulated_machine = nullptr;

}  // namespace

Machine* Machine::simulated() { return simulated_machine; }

void Machine::simulate(Machine* machine) { simulated_machine = machine; }

std::string host_name() {
  if (simulated_machine) return simulated_machine->host_name();
  char name[256] = "";
  ::gethostname(name, sizeof name - 1);
  return std::string(name).substr(0, 64);
}

int process_number() { return simulated_machine ? simulated_machine->process_number() : static_cast<int>(::getpid()); }

}  // namespace citylearn
