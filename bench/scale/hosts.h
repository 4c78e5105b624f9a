// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace citylearn::scale {

/// Hosts that are network namespaces of this machine, all on one bridge with an MTU of 1,500 bytes: what crosses eth0
/// of one is what its services said and heard. Gone with this object. Needs root. Throws Error where they cannot be
/// made.
class Hosts {
 public:
  explicit Hosts(int count);
  ~Hosts();
  Hosts(const Hosts&) = delete;
  Hosts& operator=(const Hosts&) = delete;

  /// `command` as it is run on a host.
  std::vector<std::string> on(int host, std::vector<std::string> command) const;
  static std::string address(int host) { return "10.77.0." + std::to_string(host + 1); }
  /// The calling thread, and those it starts from here on, are on that host.
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
  double others = 0;                          ///< and of all others that live: the vendor's
  double main_sleeps = 0, others_sleeps = 0;  ///< times that they gave up a processor: each time they are woken again
  double sent_bytes = 0, received_bytes = 0, sent_packets = 0, received_packets = 0;  ///< with Ethernet's headers
  double sent_datagrams = 0, received_datagrams = 0;                                  ///< of UDP, whole
  double lost_datagrams = 0;                                                          ///< its sockets were full
  double resident = 0;                                                                ///< bytes

  /// All of them, in the order in which they stand here.
  static const std::vector<double Usage::*>& fields();
  Usage& operator+=(const Usage& other);
  Usage& operator-=(const Usage& other);
  Usage& operator*=(double factor);
};

/// Throws Error when there is no such process.
Usage usage_of(int process);

/// Seconds that all processors of this machine were idle so far.
double idle_processor_seconds();

}  // namespace citylearn::scale
