// SPDX-License-Identifier: Apache-2.0
#include "core/dds/middleware.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sched.h>
#include <spdlog/fmt/fmt.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstring>
#include <future>
#include <thread>

#include "core/dds/middleware_internal.h"
#include "core/dds/security.h"
#include "core/dds/wakeup.h"
#include "core/util/error.h"
#include "core/util/ipv4.h"
#include "core/util/machine.h"

namespace citylearn {
namespace internal {

namespace {

/// The time that wait() spins before it sleeps: several round trips on loopback, but little compared with a usual
/// pause.
constexpr std::chrono::microseconds kSpinTime{100};

/// Returns the bytes that an interface sends in one packet.
int packet_size(const char* name) {
  ifreq request{};
  std::snprintf(request.ifr_name, sizeof request.ifr_name, "%s", name);
  const int handle = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const bool known = handle >= 0 && ioctl(handle, SIOCGIFMTU, &request) == 0;
  if (handle >= 0) close(handle);
  return known ? request.ifr_mtu : 1500;
}

}  // namespace

Depth depth_of(Profile profile) {
  switch (profile) {
    case Profile::kState:
      return {1, 1024};
    case Profile::kCommand:
      return {64, 4096};
    case Profile::kDurable:
      return {256, 4096};
    case Profile::kRos2:
    case Profile::kRos2Reliable:
      return {10, 10};
  }
  throw Error("unknown profile");
}

void check_size(const Topic& topic, std::size_t size) {
  if (size > topic.largest)
    throw Error(
        "sample of " + std::to_string(size) + " bytes, at most " + std::to_string(topic.largest) + " are allowed",
        "topic " + topic.name);
}

bool Wakeup::any_raised() const {
  for (const Flag* flag : flags_)
    if (flag->raised()) return true;
  return false;
}

void Wakeup::wake() {
  // The flag was raised before asleep_ is read here, and wait() sets asleep_ before it reads the flags a last time: one
  // of the two sees the other (all of these are sequentially consistent). It is not waited for while a handler runs,
  // which may need what this thread holds: the thread that runs it looks at the flags afterwards.
  std::unique_lock lock(mutex_, std::defer_lock);
  while (asleep_ && !lock.try_lock()) sched_yield();
  if (!lock || !asleep_) return;
  if (handler_ && !called_) {
    asleep_ = false;
    try {
      called_ = handler_();
    } catch (...) {
      failure_ = std::current_exception();
    }
    asleep_ = true;  // first: what is raised from here on waits for the mutex
    called_ = called_ || failure_ || any_raised();
    if (!called_) return;
  }
  lock.unlock();
  condition_.notify_one();
}

bool Wakeup::look(Clock::time_point deadline) const {
  do {
    if (any_raised()) return true;
    sched_yield();  // the vendor's thread that we look out for may need this very processor
  } while (Clock::now() < deadline);
  return false;
}

bool Wakeup::wait(Clock::time_point deadline) {
  if (any_raised()) return true;
  const Clock::time_point begin = Clock::now();
  const Clock::time_point patience = begin + kSpinTime;
  if (!handler_ && look_first_ && look(std::min(deadline, patience))) return true;
  std::unique_lock lock(mutex_);
  asleep_ = true;
  const bool raised = condition_.wait_until(lock, deadline, [this] { return called_ || any_raised(); });
  asleep_ = called_ = false;
  if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  look_first_ = raised && Clock::now() < patience;
  return raised;
}

std::vector<Interface> interfaces() {
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) throw Error(std::strerror(errno), "network interfaces");
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, freeifaddrs);
  std::vector<Interface> all;
  for (const ifaddrs* entry = list; entry; entry = entry->ifa_next)
    if (entry->ifa_addr && entry->ifa_addr->sa_family == AF_INET)
      all.push_back({entry->ifa_name, dotted(reinterpret_cast<const sockaddr_in*>(entry->ifa_addr)->sin_addr),
                     packet_size(entry->ifa_name), (entry->ifa_flags & IFF_UP) != 0});
  return all;
}

int free_index(const Network& network) {
  const auto is_free_at = [](const std::string& where, int port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    inet_pton(AF_INET, where.c_str(), &address.sin_addr);
    const int handle = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    const bool bound = handle >= 0 && bind(handle, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    if (handle >= 0) close(handle);
    return bound;
  };
  const auto is_free = [&](int port) {
    return std::all_of(network.addresses.begin(), network.addresses.end(),
                       [&](const std::string& where) { return is_free_at(where, port); });
  };
  for (int index = 0; index < kParticipants; ++index) {
    const int port = discovery_port(network.domain, index);
    if (is_free(port) && is_free(port + 1)) return index;
  }
  throw Error("all " + std::to_string(kParticipants) + " participants' ports of domain " +
                  std::to_string(network.domain) + " are taken on " + network.interfaces,
              "domain", "a host has room for so many services in a domain; choose another one for other sessions");
}

void expect_peers(const Network& network, DiscoveryMonitor& discovery) {
  for (const auto* list : {&network.peers, &network.discovery_servers})
    for (const Network::Peer& peer : *list)
      if (!peer.address.starts_with("127.") &&
          std::find(network.addresses.begin(), network.addresses.end(), peer.address) == network.addresses.end())
        discovery.expect_peer(peer.name, peer.address);
}

std::string vendor_name(std::uint8_t major, std::uint8_t minor) {
  if (major == 0x01 && minor == 0x0F) return "fastdds";
  if (major == 0x01 && minor == 0x10) return "cyclonedds";
  return fmt::format("vendor {:02x}.{:02x}", major, minor);
}

}  // namespace internal

namespace {

using internal::Network;

constexpr int kMaxDatagram = 65500;  // UDP over IPv4 has room for 65507
constexpr int kHeaders = 28;         // of IPv4 and UDP

bool is_loopback(const std::string& address) { return address.starts_with("127."); }

/// Returns the interface given by name or by IPv4 address.
internal::Interface resolve_interface(const std::string& wanted) {
  std::string known;
  for (const internal::Interface& each : internal::interfaces()) {
    if (!each.up) continue;
    if (wanted == each.name || wanted == each.address) return each;
    known += (known.empty() ? "" : ", ") + each.name + " " + each.address;
  }
  throw Error("unknown interface '" + wanted + "'", "interface", "those with IPv4: " + known);
}

constexpr std::string_view kDnsPrefix = "dns:";

/// Returns one entry for each address of the host. `option` is where the host was given, for messages. Without a port
/// it gets `standard`. "dns:NAME" is a name of containers that come and go: it may have no address yet, since those
/// that start later ask for ours.
std::vector<Network::Peer> resolve_peer(const std::string& peer, const std::string& option, int standard) {
  const bool may_be_unknown = peer.starts_with(kDnsPrefix);
  std::string host = may_be_unknown ? peer.substr(kDnsPrefix.size()) : peer;
  if (host.empty()) throw Error("'" + peer + "' names no host", option, "write HOST, HOST:PORT or dns:NAME");
  int port = standard;
  if (const std::size_t colon = host.rfind(':'); colon != std::string::npos) {
    const std::string digits = host.substr(colon + 1);
    host.resize(colon);
    if (digits.empty() || digits.size() > 5 || digits.find_first_not_of("0123456789") != std::string::npos)
      throw Error("'" + peer + "' has no valid port", option, "write HOST or HOST:PORT");
    port = std::stoi(digits);
    if (port < 1 || port > 65535) throw Error("'" + peer + "' has no valid port", option, "ports are 1..65535");
  }
  const Ipv4Lookup found = find_ipv4(host);
  if (found.addresses.empty() && !may_be_unknown)
    throw Error("host '" + host + "' has no IPv4 address: " + found.problem, option);
  std::vector<Network::Peer> peers;
  for (const std::string& address : found.addresses) peers.push_back({peer, address, port});
  return peers;
}

/// Returns the result of resolve_peer() for each of them. They are asked for at once: a name server that is silent
/// costs its timeout once instead of once for each name.
std::vector<std::vector<Network::Peer>> resolve_peers(const std::vector<std::string>& peers, const std::string& option,
                                                      int standard) {
  constexpr std::size_t kMaxLookups = 32;
  std::vector<std::packaged_task<std::vector<Network::Peer>()>> lookups;
  for (const std::string& peer : peers) lookups.emplace_back([&] { return resolve_peer(peer, option, standard); });
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < lookups.size(); i = next++) lookups[i]();
  };
  std::vector<std::jthread> helpers;
  for (std::size_t i = 1; i < std::min(kMaxLookups, lookups.size()); ++i) helpers.emplace_back(work);
  work();
  helpers.clear();
  std::vector<std::vector<Network::Peer>> found;
  for (auto& lookup : lookups) found.push_back(lookup.get_future().get());
  return found;
}

/// Fills in the interfaces that the options name, and that this host's own addresses are peers.
void use_named_interfaces(const MiddlewareOptions& options, Network& network) {
  if (options.interfaces.empty()) throw Error("name at least one", "interface");
  std::vector<internal::Interface> interfaces;
  for (const std::string& interface : options.interfaces) interfaces.push_back(resolve_interface(interface));
  network.loopback_only = std::all_of(interfaces.begin(), interfaces.end(),
                                      [](const internal::Interface& each) { return is_loopback(each.address); });
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    const std::string& interface = options.interfaces[i];
    network.interfaces += (network.interfaces.empty() ? "" : ",") + interface;
    const std::string& address = interfaces[i].address;
    // Beside another interface it has no use: a host that is told we are at 127.0.0.1 would talk to itself. This
    // host's services reach each other at the other interface's address, and no packet of that leaves the machine.
    if (!network.loopback_only && is_loopback(address)) continue;
    if (std::find(network.addresses.begin(), network.addresses.end(), address) != network.addresses.end()) continue;
    network.datagram = std::min(network.datagram, interfaces[i].packet - kHeaders);
    network.addresses.push_back(address);
    network.peers.push_back({interface, address, 0});
  }
}

/// Fills in all interfaces of this host.
void use_all_interfaces(Network& network) {
  network.interfaces = "all interfaces";
  for (const internal::Interface& each : internal::interfaces())
    if (each.up) network.addresses.push_back(each.address);
}

Network resolve(const MiddlewareOptions& options) {
  Network network{options.domain, options.participant, "", {}, false, kMaxDatagram, {}, {}, ""};
  if (!options.security.empty() && options.domain > internal::kMaxSecureDomain)
    throw Error("must be 0.." + std::to_string(internal::kMaxSecureDomain) + " with --security", "domain");
  if (!options.security.empty()) network.security = internal::check_security(options.security, options.participant);
  network.multicast = options.multicast;
  network.user_data = options.user_data;
  options.multicast ? use_all_interfaces(network) : use_named_interfaces(options, network);
  const auto check_reachable = [&](const Network::Peer& peer, const std::string& option) {
    if (network.loopback_only && !is_loopback(peer.address))
      throw Error("'" + peer.name + "' cannot be reached through interface '" + network.interfaces + "'", option,
                  "name the interface that leads there");
  };
  for (const std::vector<Network::Peer>& found : resolve_peers(options.peers, "peers", 0))
    for (const Network::Peer& each : found) {
      check_reachable(each, "peers");
      network.peers.push_back(each);
    }
  const auto servers = resolve_peers(options.discovery_servers, "discovery-server", internal::kDiscoveryServerPort);
  for (std::size_t i = 0; i < servers.size(); ++i) {
    // One entry each, because the position of a server is its id.
    if (servers[i].empty())
      throw Error("'" + options.discovery_servers[i] + "' has no IPv4 address", "discovery-server",
                  "start the server first");
    check_reachable(servers[i].front(), "discovery-server");
    network.discovery_servers.push_back(servers[i].front());
  }
  return network;
}

/// The middlewares that this program was built with; those that have a wire with what starts them.
struct Known {
  const char *name, *help;
  std::unique_ptr<Middleware> (*create)(const Network& network);
};
constexpr Known kKnown[] = {
#ifdef CITYLEARN_CYCLONEDDS  // its release
    {"cyclonedds", "Eclipse Cyclone DDS " CITYLEARN_CYCLONEDDS " over UDP", internal::create_cyclonedds},
#endif
#ifdef CITYLEARN_FASTDDS
    {"fastdds", "eProsima Fast DDS " CITYLEARN_FASTDDS " over UDP", internal::create_fastdds},
#endif
    {"inprocess", "within this process, without a network; for tests and for runs in one process", nullptr},
};

}  // namespace

std::vector<std::pair<std::string, std::string>> list_middlewares() {
  std::vector<std::pair<std::string, std::string>> all;
  for (const Known& each : kKnown) all.emplace_back(each.name, each.help);
  return all;
}

std::unique_ptr<Middleware> create_middleware(const MiddlewareOptions& options) {
  const std::string& name = options.name;
  if (const std::size_t colon = name.find(':'); colon != std::string::npos) {
    const std::string decorator = name.substr(0, name.find_first_of(",:"));
    if (decorator == "lossy") {
      const std::string values = name.substr(decorator.size(), colon - decorator.size());
      internal::check_lossy(values);
      MiddlewareOptions inner = options;
      inner.name = name.substr(colon + 1);
      return internal::create_lossy(values, create_middleware(inner));
    }
  }
  if (Machine* machine = Machine::simulated()) return machine->create_middleware(options);
  if (options.domain > 232) throw Error("must be 0..232, is " + std::to_string(options.domain), "domain");
  if (!options.discovery_servers.empty() && name == "cyclonedds")
    throw Error("cyclonedds cannot use Fast DDS's", "discovery-server", "--peers finds others too");
  if (name == "inprocess" && !options.security.empty())
    throw Error("inprocess has no wire to protect", "security", "leave it out, or choose another middleware");
  if (name == "inprocess") return internal::create_inprocess(options.domain, options.participant);
  const internal::ForeignVariables ignored(options.multicast);
  for (const Known& each : kKnown)
    if (each.create && name == each.name) return each.create(resolve(options));
  const std::string known = joined(list_middlewares(), &std::pair<std::string, std::string>::first);
  throw Error("unknown middleware '" + name + "'", "middleware", "known: " + known + ", and lossy:NAME");
}

}  // namespace citylearn
