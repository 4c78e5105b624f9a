// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace citylearn::doctor {

// What a user without privileges can find out about this host's network.

/// A UDP port that is taken here.
struct Port {
  int number = 0;
  int process = 0;      ///< 0: this user may not see it
  std::string program;  ///< likewise empty
};
/// Returns the ports of first .. last that are taken, at any address, in order, without those of process `but_of`.
std::vector<Port> ports_taken(int first, int last, int but_of);

/// A setting of the kernel that large messages need.
struct Limit {
  std::string name;  ///< "net.core.rmem_max"
  std::int64_t value = 0, wanted = 0;
  std::string why;
};
/// Returns those that can be read here and are too small.
std::vector<Limit> limits_too_small();

/// Probes a peer from which no participant was heard: whether the host is there, and whether it refuses or drops a
/// packet from `from` to UDP `port`. Takes up to `patience_ms`.
enum class Answer { kNoHost, kRefused, kSilent };
Answer probe(const std::string& from, const std::string& address, int port, int patience_ms);

}  // namespace citylearn::doctor
