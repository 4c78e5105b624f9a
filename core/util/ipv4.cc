// SPDX-License-Identifier: Apache-2.0
#include "core/util/ipv4.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <sys/socket.h>

#include <algorithm>
#include <memory>

namespace citylearn {

std::string dotted(const in_addr& address) {
  char text[INET_ADDRSTRLEN] = "";
  ::inet_ntop(AF_INET, &address, text, sizeof text);
  return text;
}

Ipv4Lookup find_ipv4(const std::string& host) {
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_STREAM;  // one answer for each address, not one for each type
  addrinfo* found = nullptr;
  if (const int status = ::getaddrinfo(host.c_str(), nullptr, &hints, &found); status != 0)
    return {{}, ::gai_strerror(status)};
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(found, freeaddrinfo);
  Ipv4Lookup lookup;
  for (const addrinfo* entry = found; entry; entry = entry->ai_next) {
    const std::string address = dotted(reinterpret_cast<const sockaddr_in*>(entry->ai_addr)->sin_addr);
    if (std::find(lookup.addresses.begin(), lookup.addresses.end(), address) == lookup.addresses.end())
      lookup.addresses.push_back(address);
  }
  return lookup;
}

}  // namespace citylearn
