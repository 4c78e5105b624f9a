// SPDX-License-Identifier: Apache-2.0
#pragma once

// What the middlewares share among themselves. It is private to core/dds; the doctor reads its ports.

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/dds/middleware.h"

namespace citylearn::internal {

/// Participants of one domain on one host: each takes a pair of ports, and each is asked for at start. Ports of the
/// highest domain would allow 62; every further one costs all others a packet at each announcement.
inline constexpr int kParticipants = 48;

/// The longest that a publisher waits for room; with KEEP_LAST there always is some.
inline constexpr std::chrono::milliseconds kBlocking{100};

/// Samples kept. A reader is deeper than a writer: topics are keyless, so the samples of all writers share its history,
/// and each must stay until it is taken.
struct Depth {
  int writer;
  int reader;
};
Depth depth_of(Profile profile);
/// Returns whether late readers get a writer's samples (TRANSIENT_LOCAL).
inline bool is_kept(Profile profile) { return profile != Profile::kRos2 && profile != Profile::kRos2Reliable; }

/// Returns the first UDP port of the participant with this index (its discovery port; data arrives at the next one).
/// RTPS 2.2, 9.6.1.
inline int discovery_port(std::uint32_t domain, int index) {
  return 7400 + 250 * static_cast<int>(domain) + 10 + 2 * index;
}
/// Returns the UDP port at which participants announce themselves by multicast.
inline int announcement_port(std::uint32_t domain) { return discovery_port(domain, 0) - 10; }

/// The port of Fast DDS's discovery server by default.
inline constexpr int kDiscoveryServerPort = 11811;

/// A network interface of this host that has an IPv4 address.
struct Interface {
  std::string name, address;
  int packet = 0;  ///< bytes it sends in one packet
  bool up = false;
};
/// Returns one for each address. Throws Error when the system call fails.
std::vector<Interface> interfaces();

/// MiddlewareOptions with the network resolved and checked.
struct Network {
  struct Peer {
    std::string name;     ///< as given
    std::string address;  ///< IPv4
    int port;             ///< 0: the discovery ports of every index
  };
  std::uint32_t domain;
  std::string participant;
  std::string interfaces;               ///< as given, for messages
  std::vector<std::string> addresses;   ///< IPv4 addresses of the interfaces, at least one
  bool loopback_only;                   ///< loopback alone
  int datagram;                         ///< bytes of UDP payload that cross the interfaces in one packet, at most 65500
  std::vector<Peer> peers;              ///< this host's own addresses come first
  std::vector<Peer> discovery_servers;  ///< each with a port
  std::string security;                 ///< folder with keys; empty: none
  std::string user_data = {};           ///< of the participant
  bool multicast = false;               ///< the vendor's own settings hold, but for peers; `addresses` are this host's
};

/// Returns the first index whose two UDP ports are free on all addresses. Throws Error when there is none.
int free_index(const Network& network);

/// Tells `discovery` of the user's peers and discovery servers that someone should be heard there, this host's own
/// addresses excepted.
void expect_peers(const Network& network, DiscoveryMonitor& discovery);

/// Returns "fastdds", "cyclonedds" or "vendor 01.03".
std::string vendor_name(std::uint8_t major, std::uint8_t minor);

/// Throws Error when the sample is larger than its topic allows.
void check_size(const Topic& topic, std::size_t size);

/// Keeps a vendor from what the user of another program has told it by the environment, from here until the end of
/// this object (docs/how-to/connect-hosts.md has the table). With `ros2` ROS_DISCOVERY_SERVER holds, as for the nodes
/// that are to be met. As setenv(), it must not meet another thread that reads or changes the environment.
class ForeignVariables {
 public:
  explicit ForeignVariables(bool ros2);
  ~ForeignVariables();
  ForeignVariables(const ForeignVariables&) = delete;
  ForeignVariables& operator=(const ForeignVariables&) = delete;
  /// Returns a line for each such variable that is set (or file that is here), which says what is done with it.
  static std::vector<std::string> found();

 private:
  std::vector<std::pair<const char*, std::optional<std::string>>> before_;
};

std::unique_ptr<Middleware> create_fastdds(const Network& network);
std::unique_ptr<Middleware> create_cyclonedds(const Network& network);
std::unique_ptr<Middleware> create_inprocess(std::uint32_t domain, const std::string& participant);
/// `options` is what stands between "lossy" and ":", for example ",drop=0.2".
std::unique_ptr<Middleware> create_lossy(const std::string& options, std::unique_ptr<Middleware> inner);
/// Throws Error when create_lossy would; so that a wrong option is reported before a vendor starts.
void check_lossy(const std::string& options);

}  // namespace citylearn::internal
