// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>

namespace citylearn {

class Middleware;
struct MiddlewareOptions;

/// The machine that a simulated service runs on (docs/explanation/simulation.md). Each simulated process has one.
/// Elsewhere there is none, and the operating system answers. Time is not part of it: a simulation replaces the
/// system's clocks themselves.
class Machine {
 public:
  virtual ~Machine() = default;
  virtual std::string host_name() = 0;
  virtual int process_number() = 0;
  /// Returns whether the process was asked to stop, as SIGTERM does.
  virtual bool stop_requested() = 0;
  /// Takes the place of every middleware, whatever its name.
  virtual std::unique_ptr<Middleware> create_middleware(const MiddlewareOptions& options) = 0;

  /// Returns the machine that the calling thread runs on; null unless that is a simulated one. Simulated processes have
  /// one thread each: what others do in the background they do at once.
  static Machine* simulated();
  /// Sets it for the calling thread.
  static void simulate(Machine* machine);
};

/// Returns the name of this host, at most 64 characters.
std::string host_name();
/// Returns the number of this process.
int process_number();

/// Resources of the machine that this process uses.
struct ProcessUse {
  double processor_seconds = 0;  ///< user and system time of all its threads since it began
  std::uint64_t resident = 0;    ///< bytes of memory
};
/// Returns what the operating system counts; zeros where the machine is simulated.
ProcessUse process_use();

}  // namespace citylearn
