// SPDX-License-Identifier: Apache-2.0
// Names, domains, interfaces, and what happens when a vendor cannot start: one clear line, soon, never another
// middleware.
#include <arpa/inet.h>
#include <dlfcn.h>
#include <gtest/gtest.h>
#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <condition_variable>
#include <map>
#include <mutex>
#include <set>

#include "core/dds/middleware.h"
#include "core/util/error.h"
#include "core/wire/node.h"
#include "tests/support/options.h"
#include "tests/support/text.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

/// Stands for a slow name server: it knows the names of a zone once it was asked for three of them.
class SlowNames {
 public:
  /// Returns whether it knows the name. Waits for questions about the others, but no longer than resolvers do.
  bool knows(const std::string& name) {
    std::unique_lock lock(mutex_);
    std::set<std::string>& asked = asked_[name.substr(name.find('.'))];
    asked.insert(name);
    changed_.notify_all();
    return changed_.wait_for(lock, std::chrono::seconds(10), [&] { return asked.size() >= 3; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, std::set<std::string>> asked_;  // by zone
};

}  // namespace
}  // namespace citylearn::testing

/// Takes the place of libc's in this program.
extern "C" int getaddrinfo(const char* name, const char* service, const addrinfo* hints, addrinfo** found) {
  static const auto real = reinterpret_cast<decltype(&getaddrinfo)>(dlsym(RTLD_NEXT, "getaddrinfo"));
  static citylearn::testing::SlowNames slow;
  if (!name || !std::string_view(name).ends_with(".together.test")) return real(name, service, hints, found);
  return slow.knows(name) ? real("127.0.0.1", service, hints, found) : EAI_AGAIN;
}

namespace citylearn::testing {
namespace {

constexpr std::uint32_t kStartDomain = 103;
constexpr std::uint32_t kFullDomain = 104;
constexpr std::uint32_t kMeetingDomain = 64;

std::string start_error(MiddlewareOptions options) {
  const Clock::time_point begin = Clock::now();
  std::string line = error_of([&] { create_middleware(options); });
  EXPECT_LT(Clock::now() - begin, seconds(5 * kSlowness));
  EXPECT_FALSE(contains(line, "\n"));
  return line;
}

MiddlewareOptions options_of(const std::string& name) { return middleware_options(name, kStartDomain); }

TEST(Start, UnknownNamesListTheKnown) {
  EXPECT_EQ(start_error(options_of("opensplice")),
            "middleware: unknown middleware 'opensplice' (known: cyclonedds, fastdds, inprocess, and lossy:NAME)");
  EXPECT_NE(start_error(options_of("")), "");
  EXPECT_NE(start_error(options_of("lossy:")), "");
  EXPECT_NE(start_error(options_of("lossy:rti")), "");
  EXPECT_NE(start_error(options_of("perfect:inprocess")), "");
}

TEST(Start, WrongLossIsAnError) {
  EXPECT_EQ(start_error(options_of("lossy,drop=2:inprocess")), "middleware lossy, drop: must be 0..1, is 2");
  EXPECT_EQ(start_error(options_of("lossy,drop=:inprocess")), "middleware lossy, drop: '' is not a number");
  EXPECT_EQ(start_error(options_of("lossy,drop=nan:inprocess")), "middleware lossy, drop: must be 0..1, is nan");
  EXPECT_EQ(start_error(options_of("lossy,seed=-1:inprocess")), "middleware lossy, seed: '-1' is not a number");
  EXPECT_EQ(start_error(options_of("lossy,delay=1:inprocess")),
            "middleware lossy: unknown option 'delay' (known: drop, repeat, reorder, seed)");
  EXPECT_EQ(start_error(options_of("lossy,drop=0.5,seed=9:inprocess")), "");
}

TEST(Start, AllListedOnesStart) {
  for (const auto& [name, help] : list_middlewares())
    EXPECT_EQ(start_error(options_of(name)), "") << name << ": " << help;
}

TEST(Start, NodesNeedAnIdAndARun) {
  Node::Options options{options_of("inprocess"), "", "", "default"};
  EXPECT_THROW(Node{options}, Error);
  options.id = std::string(65, 'x');
  EXPECT_THROW(Node{options}, Error);
  options.id = std::string(64, 'x');
  EXPECT_NO_THROW(Node{options});
  options.session = std::string(65, 'x');
  EXPECT_THROW(Node{options}, Error);
}

class Vendor : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(All, Vendor, ::testing::Values("cyclonedds", "fastdds"),
                         [](const auto& param_info) { return param_info.param; });

TEST_P(Vendor, DomainIsChecked) {
  MiddlewareOptions options = options_of(GetParam());
  options.domain = 233;
  EXPECT_EQ(start_error(options), "domain: must be 0..232, is 233");
  options.domain = 232;
  EXPECT_EQ(start_error(options), "");
}

TEST_P(Vendor, InterfaceIsChecked) {
  MiddlewareOptions options = options_of(GetParam());
  options.interfaces = {"wan7"};
  EXPECT_TRUE(start_error(options).starts_with("interface: unknown interface 'wan7' (those with IPv4: "))
      << start_error(options);
  options.interfaces = {"203.0.113.9"};
  EXPECT_NE(start_error(options), "");
  options.interfaces = {"127.0.0.1"};
  EXPECT_EQ(start_error(options), "");
}

TEST_P(Vendor, PeersAreChecked) {
  MiddlewareOptions options = options_of(GetParam());
  options.peers = {"127.0.0.1", "127.0.0.1:17410"};
  EXPECT_EQ(start_error(options), "");
  options.peers = {"127.0.0.1:port"};
  EXPECT_NE(start_error(options), "");
  options.peers = {"127.0.0.1:70000"};
  EXPECT_NE(start_error(options), "");
  options.peers = {"203.0.113.9"};
  EXPECT_EQ(start_error(options),
            "peers: '203.0.113.9' cannot be reached through interface 'lo' (name the interface that leads there)");
}

TEST_P(Vendor, DnsPeersMayHaveNoAddressYet) {
  MiddlewareOptions options = options_of(GetParam());
  options.peers = {"nobody.invalid"};
  EXPECT_TRUE(start_error(options).starts_with("peers: host 'nobody.invalid' has no IPv4 address: "));
  options.peers = {"dns:nobody.invalid", "dns:nobody.invalid:17410", "dns:localhost"};
  EXPECT_EQ(start_error(options), "");
  options.peers = {"dns:"};
  EXPECT_EQ(start_error(options), "peers: 'dns:' names no host (write HOST, HOST:PORT or dns:NAME)");
  options.peers = {"dns:nobody.invalid:port"};
  EXPECT_NE(start_error(options), "");
}

TEST_P(Vendor, AsksForAllPeersAtOnce) {
  MiddlewareOptions options = options_of(GetParam());
  const std::string zone = "." + GetParam() + ".together.test";
  options.peers = {"a" + zone, "b" + zone, "c" + zone};
  EXPECT_EQ(start_error(options), "");
}

TEST_P(Vendor, NoFreePortIsAnError) {
  std::vector<int> sockets;
  for (int index = 0; index < 62; ++index) {
    const int handle = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(7400 + 250 * kFullDomain + 10 + 2 * index));
    // When a port is taken already, all the better.
    static_cast<void>(bind(handle, reinterpret_cast<const sockaddr*>(&address), sizeof address));
    sockets.push_back(handle);
  }
  MiddlewareOptions options = options_of(GetParam());
  options.domain = kFullDomain;
  const std::string line = start_error(options);
  EXPECT_EQ(
      line,
      "domain: all 48 participants' ports of domain 104 are taken on lo (a host has room for so many services in a "
      "domain; choose another one for other sessions)");
  for (int handle : sockets) close(handle);
  EXPECT_EQ(start_error(options), "");
}

TEST_P(Vendor, DiscoveryServersAreFastDdsAlone) {
  MiddlewareOptions options = options_of(GetParam());
  options.discovery_servers = {"127.0.0.1"};
  EXPECT_EQ(
      start_error(options),
      GetParam() == "fastdds" ? "" : "discovery-server: cyclonedds cannot use Fast DDS's (--peers finds others too)");
  options.discovery_servers = {"203.0.113.9"};
  EXPECT_NE(start_error(options), "");
}

TEST_P(Vendor, TheOthersAreKnownByNameVendorAndAddress) {
  MiddlewareOptions options = options_of(GetParam());
  options.domain = kMeetingDomain;
  options.participant = "one";
  const auto one = create_middleware(options);
  for (const std::string other : {"cyclonedds", "fastdds"}) {
    options.name = other;
    options.participant = "the other";
    const auto two = create_middleware(options);
    const auto met = [&](Middleware& here, const std::string& name, const std::string& vendor) {
      for (const DiscoveryMonitor::Participant& each : here.discovery().participants())
        if (each.name == name && each.vendor == vendor && each.addresses == std::vector<std::string>{"127.0.0.1"})
          return true;
      return false;
    };
    EXPECT_TRUE(eventually(*one, [&] { return met(*one, "the other", other); })) << other;
    EXPECT_TRUE(eventually(*two, [&] { return met(*two, "one", GetParam()); })) << other;
    EXPECT_FALSE(met(*one, "one", GetParam())) << "itself";
  }
}

}  // namespace
}  // namespace citylearn::testing
