// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <utility>

#include "core/dds/middleware.h"
#include "core/util/random.h"
#include "tests/simulation/machine/process.h"

namespace citylearn::simulation {

/// The faults of messages between two processes.
struct LinkFaults {
  double loss = 0;        ///< share of messages lost for good, which real readers and writers would mostly resend
  double repetition = 0;  ///< share that arrives twice
  double reordering = 0;  ///< share that others may overtake
  double corruption = 0;  ///< share that arrives cut short, or as random bytes
  double slow = 0;        ///< share that takes up to `longest` instead of about `latency`
  Time latency = std::chrono::milliseconds(5);  ///< on average; so long that a training lasts for a while
  Time longest = std::chrono::milliseconds(100);
  /// Nothing goes wrong, and messages arrive at multiples of `latency`, so that a reader takes many at once.
  bool even = false;
};

struct Traffic {
  std::uint64_t published = 0, copies = 0, bytes = 0, delivered = 0, lost = 0, repeated = 0, cut = 0, corrupt = 0;
};

/// The largest numbers of endpoints that a topic had.
struct Endpoints {
  std::size_t writers = 0, readers = 0, matches = 0;
};

/// The network between simulated processes. What one process publishes reaches the others after a while, or never.
class Network {
 public:
  struct Endpoint;

  Network(Scheduler& scheduler, std::uint64_t seed);
  ~Network();

  /// Returns the middleware of a process. Messages within the process are delivered at once.
  std::unique_ptr<Middleware> join(Process& process);

  /// Drops all that `from` sends to `to`, by name, until mend().
  void cut(const std::string& from, const std::string& to) { cuts_.insert({from, to}); }
  void mend(const std::string& from, const std::string& to) { cuts_.erase({from, to}); }
  void mend_all() { cuts_.clear(); }
  LinkFaults faults;

  /// Called with each message that a process published, before it is sent.
  std::function<void(Process& sender, const Topic& topic, std::span<const std::byte> sample)> published;
  /// Called with each message that arrives at a process, whether it takes it or not.
  std::function<void(Process& receiver, const Topic& topic, std::span<const std::byte> sample)> arrived;
  std::map<std::string, Traffic> traffic() const;      ///< by topic
  std::map<std::string, Endpoints> endpoints() const;  ///< by topic

  // For the middlewares of its processes.
  void add(Endpoint& endpoint);
  void remove(Endpoint& endpoint);
  void publish(Endpoint& writer, std::span<const std::byte> sample);
  int matched(const Endpoint& endpoint) const;
  /// Tells `discovery` of the endpoints that are newer than `seen`, and sets `seen` to the newest.
  void report_new(std::uint64_t& seen, DiscoveryMonitor& discovery) const;

 private:
  using Sample = std::shared_ptr<const Bytes>;
  struct Members {  ///< of a topic
    std::map<std::uint64_t, Endpoint*> readers, writers;
    Traffic traffic;
    Endpoints most;
  };
  void send(Endpoint& writer, Endpoint& reader, Sample sample);
  void send_evenly(Endpoint& writer, const Sample& sample);
  Sample corrupt(const Bytes& sample);
  void deliver(Members& topic, std::uint64_t reader, const Sample& sample);

  Scheduler& scheduler_;
  Random random_;
  std::map<std::string, Members> topics_;
  std::map<std::uint64_t, Endpoint*> endpoints_;
  std::set<std::pair<std::string, std::string>> cuts_;
  std::uint64_t last_endpoint_ = 0;
};

}  // namespace citylearn::simulation
