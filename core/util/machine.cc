// SPDX-License-Identifier: Apache-2.0
#include "core/util/machine.h"

#include <sys/resource.h>
#include <unistd.h>

#include <fstream>

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

ProcessUse process_use() {
  ProcessUse use;
  if (simulated_machine) return use;
  rusage used{};
  ::getrusage(RUSAGE_SELF, &used);
  const auto seconds = [](const timeval& t) { return double(t.tv_sec) + double(t.tv_usec) * 1e-6; };
  use.processor_seconds = seconds(used.ru_utime) + seconds(used.ru_stime);
  std::uint64_t pages = 0, resident = 0;
  if (std::ifstream("/proc/self/statm") >> pages >> resident)
    use.resident = resident * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  return use;
}

}  // namespace citylearn
