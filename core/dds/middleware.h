// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/dds/discovery_monitor.h"
#include "core/util/types.h"

namespace citylearn {

/// Named quality of service. All are RELIABLE and KEEP_LAST; all but those for ROS 2 are TRANSIENT_LOCAL. With these no
/// pairing of the vendors lost a sample (docs/decisions/0002-qos.md). They differ in their depth: how many samples a
/// writer keeps for late or slow readers.
enum class Profile {
  kState,         ///< depth 1: only the newest counts
  kCommand,       ///< depth 64: requests and settings
  kDurable,       ///< depth 256: chunks and records
  kRos2,          ///< for ROS 2: VOLATILE, depth 10; subscriptions are BEST_EFFORT, which match any publisher
  kRos2Reliable,  ///< the same, but subscriptions are RELIABLE and match only RELIABLE publishers
};

/// Identifies a participant, a writer or a reader, in the bytes of the wire. All zero where there is no wire.
using Guid = std::array<std::uint8_t, 16>;

/// Everything a vendor needs to know about a topic. Payloads are CDR (XCDR1, 4 bytes of encapsulation first): the
/// middleware moves bytes, core/wire/messages.h gives them types.
struct Topic {
  std::string name;  ///< "citylearn/observation"
  std::string type;  ///< IDL type, "citylearn::msg::Observation"
  Profile profile;
  std::size_t largest;         ///< bytes of the largest sample, encapsulation included
  bool read_by_all = false;    ///< every service has a reader
  std::string user_data = {};  ///< USER_DATA of writers and readers: others see it when they discover them
};

/// Sends samples of one topic. Used by one thread at a time. Must not outlive its Middleware.
class Publisher {
 public:
  virtual ~Publisher() = default;
  /// Copies the sample and returns before it is delivered. Throws Error when the sample is larger than
  /// Topic::largest.
  virtual void publish(std::span<const std::byte> sample) = 0;
  /// Returns the number of subscriptions that match now.
  virtual int matched() const = 0;
  virtual Guid guid() const { return {}; }
  /// Waits until the subscriptions have all samples, at most until the deadline. Only vendors whose publishers resend
  /// nothing once destroyed override it.
  virtual void wait_for_acknowledgments(Clock::time_point) {}
};

/// Receives samples of one topic. Used by one thread at a time. Must not outlive its Middleware.
class Subscription {
 public:
  virtual ~Subscription() = default;
  /// Takes the next sample into `sample` (its capacity is reused). Returns false when there is none.
  virtual bool take(Bytes& sample) = 0;
  /// Returns the number of publishers that match now.
  virtual int matched() const = 0;
  virtual Guid guid() const { return {}; }
};

/// One participant in one DDS domain. Used by one thread at a time.
class Middleware {
 public:
  virtual ~Middleware() = default;
  virtual std::unique_ptr<Publisher> create_publisher(const Topic& topic) = 0;
  virtual std::unique_ptr<Subscription> create_subscription(const Topic& topic) = 0;
  /// Waits until a subscription may have a sample (true) or the deadline has passed (false). May return true early.
  virtual bool wait(Clock::time_point deadline) = 0;
  /// Lets the vendor's thread that receives a sample call `handler` while another one is in wait(), which then returns
  /// true if the handler has returned true or left samples, and throws what it throws. It must not create or delete
  /// publishers and subscriptions. Null: none. Ignored by a middleware without such threads.
  virtual void answer_at_once(const std::function<bool()>&) {}
  /// Returns the participants and endpoints discovered up to now.
  virtual DiscoveryMonitor& discovery() = 0;
  virtual Guid guid() const { return {}; }
  /// Returns "fastdds", "cyclonedds" or "inprocess"; decorators put their own name in front: "lossy:fastdds".
  virtual std::string name() const = 0;
};

/// Returns the names accepted by create_middleware, decorators excluded, each with a line of help: those that this
/// program was built with, cyclonedds first, inprocess last.
std::vector<std::pair<std::string, std::string>> list_middlewares();

struct MiddlewareOptions {
  std::string name = list_middlewares().front().first;  ///< an unknown or failing one is an Error, and not replaced
  std::uint32_t domain = 0;                             ///< 0..232
  std::vector<std::string> interfaces = {"lo"};  ///< the only ones used, by name or IPv4 address; "lo": this machine
  bool multicast = false;          ///< uses the interfaces that the vendor chooses instead, and finds others by
                                   ///< multicast, as ROS 2 does by default
  std::vector<std::string> peers;  ///< hosts (or host:port) on which to look for participants, beside this machine
  std::vector<std::string> discovery_servers;  ///< host[:port], instead of asking peers; fastdds only
  std::string security;     ///< folder with this service's keys (docs/how-to/secure-a-run.md); empty: none
  std::string participant;  ///< name shown to other participants
  std::string user_data;    ///< its USER_DATA, "key=value;" each, likewise
};

/// Creates the middleware `options.name`: `fastdds`, `cyclonedds`, `inprocess`, or a decorator in front of one:
/// `lossy:NAME` or `lossy,drop=0.1,repeat=0.1,reorder=0.1,seed=1:NAME` (shares of the samples written).
/// Throws Error (naming the known ones) for an unknown name, a domain outside 0..232, an unknown interface, or a vendor
/// that cannot start.
std::unique_ptr<Middleware> create_middleware(const MiddlewareOptions& options);

}  // namespace citylearn
