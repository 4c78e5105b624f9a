// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace citylearn::simulation {

/// A process of an env_service: its id and incarnation.
using Source = std::pair<std::string, std::uint64_t>;

/// The episodes that a recorder has: the policy_service or a dashboard.
struct Records {
  std::map<Source, std::uint64_t> acknowledged;             ///< all of the source's up to this one
  std::map<Source, std::map<std::uint64_t, int>> recorded;  ///< how often each stands in its file
  std::map<Source, std::uint64_t> settled;                  ///< a store's: it counts on no more up to this one
  std::map<Source, std::uint64_t> missed;                   ///< a store's: those of them that it does not have
  bool ended = false;                                       ///< by itself, when it was asked to
};

/// The files that a simulation left, and what was seen on its network.
struct Evidence {
  bool at_rest = false;                      ///< all services ended in time
  bool trained = false;                      ///< the policy_service ended with status 0
  std::string state;                         ///< what each process did at the end
  std::string output;                        ///< folder of the policy_service
  std::map<std::string, Records> recorders;  ///< by name
  std::uint64_t steps = 0;                   ///< to learn from
  std::string agent;                         ///< hash of the trained agent
  std::string expected_agent;                ///< the one of a training without faults; empty: unknown
  bool envs_restarted = false;
  std::map<Source, std::uint64_t> finished;  ///< episodes of env_services that ended when nothing went wrong any more
  std::string wrong_parameters;              ///< announced ones that are not those of their checkpoint
  std::size_t memory = 0;                    ///< bytes that all processes held together, at most
  std::size_t processes = 0;
  std::vector<std::string> unexpected_errors;  ///< with which services ended: each "process: error"
  bool replayed = false;                       ///< a dashboard has seen all recordings, without faults
  Records recordings;                          ///< what they hold
  std::string recording_fault;                 ///< why one cannot be read; empty: all can
};

/// Something that holds whatever goes wrong (docs/decisions/0014-faults.md).
struct Invariant {
  const char* name;
  const char* meaning;
  std::string (*violation)(const Evidence&);  ///< what is wrong; empty: it holds
};

const std::vector<Invariant>& invariants();

}  // namespace citylearn::simulation
