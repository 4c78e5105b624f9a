// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace citylearn::scale {

/// What one process has used so far, and what has crossed its host's interface to the network.
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
