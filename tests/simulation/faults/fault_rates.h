// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "tests/simulation/machine/network.h"

namespace citylearn::simulation {

/// The rates of faults in a simulation: mean seconds between two faults of a kind; 0: there are none.
struct FaultRates {
  double kill = 0;          ///< of a process, while it waits
  double kill_at_work = 0;  ///< of a process, at one of its next messages or writes
  double partition = 0;     ///< nothing passes between two processes, for a while
  double one_way = 0;       ///< nothing passes from one process to another, for a while
  double stall = 0;         ///< a process gets no processor time, for a while
  double power = 0;         ///< of a host, at one of the next messages or writes: what was not synchronised is lost
  double full_disk = 0;     ///< a host's disk takes nothing more, for a while
  double twin = 0;          ///< a second process of the same id runs on another host, for a while
  double date_jump = 0;     ///< the date of a host changes by up to an hour
  double drift = 0;         ///< clocks run faster or slower by up to so many millionths
  bool spare_envs = false;  ///< env_services are not killed, so that a lockstep training ends with the same bytes
  LinkFaults links;         ///< of all messages
  double until = 60;        ///< seconds after which nothing goes wrong any more

  /// Leaves out the faults of a kind. Throws Error when there is no such kind.
  void leave_out(const std::string& kind);
};

/// Draws which faults there are, and how many of each. Seeds differ much, because some faults hide others.
FaultRates draw_faults(std::uint64_t seed);

}  // namespace citylearn::simulation
