// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace citylearn::scale {

/// Hosts that are network namespaces of this machine, all on one bridge with an MTU of 1,500 bytes, so that eth0 of a
/// host counts the traffic of its services. The destructor removes them. Needs root. Throws Error where they cannot be
/// made.
class Hosts {
 public:
  explicit Hosts(int count);
  ~Hosts();
  Hosts(const Hosts&) = delete;
  Hosts& operator=(const Hosts&) = delete;

  /// Returns the command line that runs `command` on a host.
  std::vector<std::string> on(int host, std::vector<std::string> command) const;
  static std::string address(int host) { return "10.77.0." + std::to_string(host + 1); }
  /// Moves the calling thread, and those it starts from here on, to that host.
  void enter(int host) const;

 private:
  std::string name(int host) const;
  void remove();

  std::string prefix_;
  int count_;
};

/// What one process has used so far, and what has crossed its host's eth0.
struct Usage {
  double main = 0;                            ///< CPU seconds of its first thread
  double others = 0;                          ///< of all other threads that live, the DDS vendor's
  double main_sleeps = 0, others_sleeps = 0;  ///< voluntary context switches
  double sent_bytes = 0, received_bytes = 0, sent_packets = 0, received_packets = 0;  ///< with Ethernet's headers
  double sent_datagrams = 0, received_datagrams = 0;                                  ///< of UDP, whole
  double lost_datagrams = 0;  ///< because a socket's buffer was full
  double resident = 0;        ///< bytes

  /// Returns all fields in this order.
  static const std::vector<double Usage::*>& fields();
  Usage& operator+=(const Usage& other);
  Usage& operator-=(const Usage& other);
  Usage& operator*=(double factor);
};

/// Returns what a process has used so far. Throws Error when there is no such process.
Usage usage_of(int process);

/// Returns for how many seconds the processors of this machine were idle so far, in all.
double idle_processor_seconds();

}  // namespace citylearn::scale
