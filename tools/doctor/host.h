// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace citylearn::doctor {

// What a user without privileges can know of this host's network.

/// A UDP port that is taken here.
struct Port {
  int number = 0;
  int process = 0;      ///< 0: not for this user to see
  std::string program;  ///< likewise empty
};
/// Those of FIRST .. LAST that are taken, at whatever address, in order. Those of `but_of` are left out.
std::vector<Port> ports_taken(int first, int last, int but_of);

/// A setting of the kernel that large messages need.
struct Limit {
  std::string name;  ///< "net.core.rmem_max"
  std::int64_t value = 0, wanted = 0;
  std::string why;
};
/// Those that can be read here and are too small.
std::vector<Limit> limits_too_small();

/// IPv4 address of a host by name, or empty.
std::string address_of(const std::string& host);

/// What answers at a peer that no participant was heard of: whether it is there at all, and whether it refuses or drops
/// a packet from `from` to UDP `port`. Takes up to `patience_ms`.
enum class Answer { kNoHost, kRefused, kSilent };
Answer probe(const std::string& from, const std::string& address, int port, int patience_ms);

}  // namespace citylearn::doctor
