// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/network.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <vector>

#include "core/dds/middleware_internal.h"

namespace citylearn::simulation {

using internal::Depth;
using internal::depth_of;

/// A reader with the samples that wait for it, or a writer with those that it keeps for later readers.
struct Network::Endpoint {
  const Topic topic;
  Process& process;
  const bool writes;
  std::uint64_t id = 0;  // set by the network
  std::deque<Sample> samples = {};
  bool raised = false;                          // a reader's: something may be there to take
  std::map<std::uint64_t, Time> arrivals = {};  // a writer's: of the last sample sent to each reader
};

namespace {

class SimulatedPublisher : public Publisher {
 public:
  SimulatedPublisher(Network& network, Process& process, const Topic& topic)
      : network_(network), endpoint_{topic, process, true} {
    network_.add(endpoint_);
  }
  ~SimulatedPublisher() override { network_.remove(endpoint_); }
  void publish(std::span<const std::byte> sample) override {
    internal::check_size(endpoint_.topic, sample.size());
    if (endpoint_.process.operate()) network_.publish(endpoint_, sample);
  }
  int matched() const override { return network_.matched(endpoint_); }

 private:
  Network& network_;
  Network::Endpoint endpoint_;
};

class SimulatedSubscription : public Subscription {
 public:
  SimulatedSubscription(Network& network, Process& process, const Topic& topic, std::vector<Network::Endpoint*>& all)
      : network_(network), all_(all), endpoint_{topic, process, false} {
    all_.push_back(&endpoint_);
    network_.add(endpoint_);
  }
  ~SimulatedSubscription() override {
    network_.remove(endpoint_);
    std::erase(all_, &endpoint_);
  }
  bool take(Bytes& sample) override {
    endpoint_.raised = !endpoint_.samples.empty();
    if (!endpoint_.raised) return false;
    sample.assign(endpoint_.samples.front()->begin(), endpoint_.samples.front()->end());
    endpoint_.samples.pop_front();
    return true;
  }
  int matched() const override { return network_.matched(endpoint_); }

 private:
  Network& network_;
  std::vector<Network::Endpoint*>& all_;
  Network::Endpoint endpoint_;
};

class SimulatedMiddleware : public Middleware {
 public:
  SimulatedMiddleware(Network& network, Process& process) : network_(network), process_(process) {}

  std::unique_ptr<Publisher> create_publisher(const Topic& topic) override {
    return std::make_unique<SimulatedPublisher>(network_, process_, topic);
  }
  std::unique_ptr<Subscription> create_subscription(const Topic& topic) override {
    return std::make_unique<SimulatedSubscription>(network_, process_, topic, readers_);
  }
  bool wait(Clock::time_point deadline) override {
    process_.wait_until(raised() ? Clock::time_point() : deadline);
    return raised();
  }
  DiscoveryMonitor& discovery() override { return discovery_; }
  std::string name() const override { return "simulated"; }

 private:
  bool raised() const {
    return std::any_of(readers_.begin(), readers_.end(), [](const auto* reader) { return reader->raised; });
  }

  Network& network_;
  Process& process_;
  std::vector<Network::Endpoint*> readers_;
  DiscoveryMonitor discovery_;
};

void push(std::deque<std::shared_ptr<const Bytes>>& samples, const std::shared_ptr<const Bytes>& sample, int depth) {
  samples.push_back(sample);
  if (samples.size() > static_cast<std::size_t>(depth)) samples.pop_front();
}

}  // namespace

Network::Network(Scheduler& scheduler, std::uint64_t seed) : scheduler_(scheduler), random_({seed, 0x4E37}) {}

Network::~Network() = default;

std::unique_ptr<Middleware> Network::join(Process& process) {
  return std::make_unique<SimulatedMiddleware>(*this, process);
}

void Network::add(Endpoint& endpoint) {
  endpoint.id = ++endpoints_;
  Members& members = topics_[endpoint.topic.name];
  (endpoint.writes ? members.writers : members.readers)[endpoint.id] = &endpoint;
  if (endpoint.writes) return;
  for (const auto& [id, writer] : members.writers)
    for (const Sample& sample : writer->samples) send(*writer, endpoint, sample);
}

void Network::remove(Endpoint& endpoint) {
  Members& members = topics_[endpoint.topic.name];
  (endpoint.writes ? members.writers : members.readers).erase(endpoint.id);
}

int Network::matched(const Endpoint& endpoint) const {
  const auto found = topics_.find(endpoint.topic.name);
  if (found == topics_.end()) return 0;
  return static_cast<int>(endpoint.writes ? found->second.readers.size() : found->second.writers.size());
}

void Network::publish(Endpoint& writer, std::span<const std::byte> bytes) {
  if (published) published(writer.process, writer.topic, bytes);
  scheduler_.note(writer.id);
  scheduler_.note(bytes.data(), bytes.size());
  ++traffic_[writer.topic.name].published;
  const Sample sample = std::make_shared<const Bytes>(bytes.begin(), bytes.end());
  push(writer.samples, sample, depth_of(writer.topic.profile).writer);
  for (const auto& [id, reader] : topics_[writer.topic.name].readers) send(writer, *reader, sample);
}

void Network::send(Endpoint& writer, Endpoint& reader, const Sample& sample) {
  if (&writer.process == &reader.process) {
    deliver(reader.topic.name, reader.id, sample);
    return;
  }
  Traffic& traffic = traffic_[reader.topic.name];
  ++traffic.copies;
  traffic.bytes += sample->size();
  const bool lost = random_.uniform() < faults.loss;
  if (lost || cuts_.contains({writer.process.name(), reader.process.name()})) {
    ++(lost ? traffic.lost : traffic.cut);
    return;
  }
  const bool repeated = random_.uniform() < faults.repetition;
  if (repeated) ++traffic.repeated;
  for (int copy = 0; copy <= (repeated ? 1 : 0); ++copy) {
    // An exponential tail over a least latency.
    double nanoseconds = static_cast<double>(faults.latency.count()) * (0.5 - 0.5 * std::log(1 - random_.uniform()));
    if (random_.uniform() < faults.slow) nanoseconds += random_.uniform() * static_cast<double>(faults.longest.count());
    Time arrival = scheduler_.now() + Time(static_cast<std::int64_t>(nanoseconds));
    if (random_.uniform() >= faults.reordering) {
      Time& last = writer.arrivals[reader.id];
      arrival = last = std::max(arrival, last);
    }
    scheduler_.at(arrival, [this, topic = reader.topic.name, id = reader.id, sample] { deliver(topic, id, sample); });
  }
}

void Network::deliver(const std::string& topic, std::uint64_t id, const Sample& sample) {
  const auto& readers = topics_[topic].readers;
  const auto found = readers.find(id);
  if (found == readers.end()) return;  // it has gone meanwhile
  Endpoint& reader = *found->second;
  push(reader.samples, sample, depth_of(reader.topic.profile).reader);
  reader.raised = true;
  ++traffic_[topic].delivered;
  reader.process.wake();
}

}  // namespace citylearn::simulation
