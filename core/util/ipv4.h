// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <netinet/in.h>

#include <string>

namespace citylearn {

/// Returns an IPv4 address in numbers, "10.0.0.1".
std::string dotted(const in_addr& address);

/// An IPv4 address in numbers, or why there is none.
struct Ipv4Lookup {
  std::string address;  ///< empty: none
  std::string problem;  ///< then, in the system's words
};
/// Looks up a host by name, or by its address in numbers.
Ipv4Lookup find_ipv4(const std::string& host);

}  // namespace citylearn
