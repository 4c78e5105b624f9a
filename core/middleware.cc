#include "core/middleware.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <sched.h>

#include <algorithm>
#include <cstring>

#include "core/error.h"
#include "core/middleware_parts.h"

namespace citylearn {
namespace parts {

namespace {

/// Several round trips on loopback, but little against the time in which nothing comes.
constexpr std::chrono::microseconds kLook{100};

}  // namespace

Depth depth_of(Profile profile) {
  switch (profile) {
    case Profile::kStream:
      return {16, 1024};
    case Profile::kState:
      return {1, 1024};
    case Profile::kCommand:
      return {64, 4096};
    case Profile::kDurable:
      return {256, 4096};
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
  // The flag was raised before this look at asleep_, and wait() sets asleep_ before its last look at the flags: one of
  // the two sees the other (all of these are sequentially consistent).
  if (!asleep_) return;
  // Empty on purpose: whoever waits is now either before its last look at the flags, or asleep and to be woken.
  { std::lock_guard lock(mutex_); }
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
  const Clock::time_point patience = begin + kLook;
  if (look_first_ && look(std::min(deadline, patience))) return true;
  std::unique_lock lock(mutex_);
  asleep_ = true;
  const bool raised = condition_.wait_until(lock, deadline, [this] { return any_raised(); });
  asleep_ = false;
  look_first_ = raised && Clock::now() < patience;
  return raised;
}

void TypeCheck::participant_found(const std::string& participant, const std::string& name) {
  std::lock_guard lock(mutex_);
  participants_[participant] = name;
}

void TypeCheck::participant_lost(const std::string& participant) {
  std::lock_guard lock(mutex_);
  participants_.erase(participant);
  std::erase_if(endpoints_, [&](const auto& item) { return item.second.participant == participant; });
}

void TypeCheck::endpoint_found(const std::string& endpoint, const std::string& participant, bool writes,
                               const std::string& topic, const std::string& type) {
  std::lock_guard lock(mutex_);
  if (endpoints_.try_emplace(endpoint, Endpoint{participant, writes, topic, type}).second) changed_ = true;
}

void TypeCheck::endpoint_lost(const std::string& endpoint) {
  std::lock_guard lock(mutex_);
  endpoints_.erase(endpoint);
}

void TypeCheck::own(const Topic& topic) {
  std::lock_guard lock(mutex_);
  const auto [known, added] = own_.try_emplace(topic.name, topic.type);
  if (!added && known->second != topic.type)
    throw Error("type is " + topic.type + ", but this process already uses it with " + known->second,
                "topic " + topic.name);
  if (added) changed_ = true;
}

std::vector<std::string> TypeCheck::faults() {
  std::vector<std::string> lines;
  if (!changed_.exchange(false)) return lines;
  std::lock_guard lock(mutex_);
  for (auto& [key, endpoint] : endpoints_) {
    const auto expected = own_.find(endpoint.topic);
    if (endpoint.reported || expected == own_.end() || expected->second == endpoint.type) continue;
    endpoint.reported = true;
    const auto name = participants_.find(endpoint.participant);
    const std::string who =
        name == participants_.end() || name->second.empty() ? "an unnamed participant" : "'" + name->second + "'";
    lines.push_back("topic " + endpoint.topic + ": " + who + (endpoint.writes ? " publishes" : " reads") + " type " +
                    endpoint.type + ", expected " + expected->second);
  }
  return lines;
}

}  // namespace parts

namespace {

using parts::Network;

std::string dotted(const sockaddr* address) {
  char text[INET_ADDRSTRLEN] = "";
  inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(address)->sin_addr, text, sizeof text);
  return text;
}

bool is_loopback(const std::string& address) { return address.starts_with("127."); }

/// IPv4 address of an interface given by name or by that address.
std::string resolve_interface(const std::string& wanted) {
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) throw Error(std::strerror(errno), "network interfaces");
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, freeifaddrs);
  std::string known;
  for (const ifaddrs* entry = list; entry; entry = entry->ifa_next) {
    if (!entry->ifa_addr || entry->ifa_addr->sa_family != AF_INET || !(entry->ifa_flags & IFF_UP)) continue;
    const std::string address = dotted(entry->ifa_addr);
    if (wanted == entry->ifa_name || wanted == address) return address;
    known += (known.empty() ? "" : ", ") + std::string(entry->ifa_name) + " " + address;
  }
  throw Error("unknown interface '" + wanted + "'", "interface", "those with IPv4: " + known);
}

Network::Peer resolve_peer(const std::string& peer) {
  std::string host = peer;
  int port = 0;
  if (const std::size_t colon = peer.rfind(':'); colon != std::string::npos) {
    host = peer.substr(0, colon);
    const std::string digits = peer.substr(colon + 1);
    if (digits.empty() || digits.size() > 5 || digits.find_first_not_of("0123456789") != std::string::npos)
      throw Error("'" + peer + "' has no valid port", "peers", "write HOST or HOST:PORT");
    port = std::stoi(digits);
    if (port < 1 || port > 65535) throw Error("'" + peer + "' has no valid port", "peers", "ports are 1..65535");
  }
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (const int status = getaddrinfo(host.c_str(), nullptr, &hints, &found); status != 0)
    throw Error("host '" + host + "' has no IPv4 address: " + gai_strerror(status), "peers");
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(found, freeaddrinfo);
  return {dotted(found->ai_addr), port};
}

Network resolve(const MiddlewareOptions& options) {
  Network network{options.domain, options.participant, options.interface, resolve_interface(options.interface), {}};
  network.peers.push_back({network.address, 0});
  for (const std::string& peer : options.peers) {
    network.peers.push_back(resolve_peer(peer));
    if (is_loopback(network.address) && !is_loopback(network.peers.back().address))
      throw Error("'" + peer + "' cannot be reached through interface '" + options.interface + "'", "peers",
                  "name the interface that leads there");
  }
  return network;
}

}  // namespace

std::vector<std::pair<std::string, std::string>> list_middlewares() {
  return {{"cyclonedds", "Eclipse Cyclone DDS over UDP"},
          {"fastdds", "eProsima Fast DDS over UDP"},
          {"inprocess", "within this process, without a network; for tests and for runs in one process"}};
}

std::unique_ptr<Middleware> create_middleware(const MiddlewareOptions& options) {
  if (options.domain > 232) throw Error("must be 0..232, is " + std::to_string(options.domain), "domain");
  const std::string& name = options.name;
  if (name == "inprocess") return parts::create_inprocess(options.domain, options.participant);
  if (name == "fastdds") return parts::create_fastdds(resolve(options));
  if (name == "cyclonedds") return parts::create_cyclonedds(resolve(options));
  if (const std::size_t colon = name.find(':'); colon != std::string::npos) {
    const std::string decorator = name.substr(0, name.find_first_of(",:"));
    if (decorator == "lossy") {
      const std::string values = name.substr(decorator.size(), colon - decorator.size());
      parts::check_lossy(values);
      MiddlewareOptions inner = options;
      inner.name = name.substr(colon + 1);
      return parts::create_lossy(values, create_middleware(inner));
    }
  }
  std::string known;
  for (const auto& [each, help] : list_middlewares()) known += (known.empty() ? "" : ", ") + each;
  throw Error("unknown middleware '" + name + "'", "middleware", "known: " + known + ", and lossy:NAME");
}

}  // namespace citylearn
