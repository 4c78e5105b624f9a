// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <netinet/in.h>

#include <string>
#include <vector>

namespace citylearn {

/// Returns an IPv4 address in numbers, "10.0.0.1".
std::string dotted(const in_addr& address);

/// A host's IPv4 addresses in numbers, or why there are none.
struct Ipv4Lookup {
  std::vector<std::string> addresses;  ///< each once, in the resolver's order; empty: none
  std::string problem;                 ///< then, in the system's words
};
/// Looks up a host by name, or by its address in numbers. Returns all addresses of the name.
Ipv4Lookup find_ipv4(const std::string& host);

}  // namespace citylearn
