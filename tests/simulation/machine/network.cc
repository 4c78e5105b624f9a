// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/machine/network.h"

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
  std::uint64_t id = 0;        // set by the network
  Members* members = nullptr;  // likewise
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
    if (endpoint_.process.operate(Process::Operation::kMessage)) network_.publish(endpoint_, sample);
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
  DiscoveryMonitor& discovery() override {
    network_.report_new(seen_, discovery_);
    return discovery_;
  }
  std::string name() const override { return "simulated"; }

 private:
  bool raised() const {
    return std::any_of(readers_.begin(), readers_.end(), [](const auto* reader) { return reader->raised; });
  }

  Network& network_;
  Process& process_;
  std::vector<Network::Endpoint*> readers_;
  DiscoveryMonitor discovery_;
  std::uint64_t seen_ = 0;
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

std::map<std::string, Traffic> Network::traffic() const {
  std::map<std::string, Traffic> all;
  for (const auto& [topic, members] : topics_) all[topic] = members.traffic;
  return all;
}

std::map<std::string, Endpoints> Network::endpoints() const {
  std::map<std::string, Endpoints> all;
  for (const auto& [topic, members] : topics_) all[topic] = members.most;
  return all;
}

void Network::add(Endpoint& endpoint) {
  Members& members = topics_[endpoint.topic.name];
  endpoint.id = ++last_endpoint_;
  endpoint.members = &members;
  endpoints_[endpoint.id] = &endpoint;
  (endpoint.writes ? members.writers : members.readers)[endpoint.id] = &endpoint;
  members.most.writers = std::max(members.most.writers, members.writers.size());
  members.most.readers = std::max(members.most.readers, members.readers.size());
  members.most.matches = std::max(members.most.matches, members.writers.size() * members.readers.size());
  if (endpoint.writes) return;
  for (const auto& [id, writer] : members.writers)
    for (const Sample& sample : writer->samples) send(*writer, endpoint, sample);
}

void Network::report_new(std::uint64_t& seen, DiscoveryMonitor& discovery) const {
  if (seen == last_endpoint_) return;
  for (auto found = endpoints_.upper_bound(seen); found != endpoints_.end(); ++found) {
    const Endpoint& endpoint = *found->second;
    discovery.endpoint_found(std::to_string(endpoint.id), endpoint.process.name(), endpoint.writes, endpoint.topic.name,
                             endpoint.topic.type);
  }
  seen = last_endpoint_;
}

void Network::remove(Endpoint& endpoint) {
  endpoints_.erase(endpoint.id);
  (endpoint.writes ? endpoint.members->writers : endpoint.members->readers).erase(endpoint.id);
}

int Network::matched(const Endpoint& endpoint) const {
  return static_cast<int>(endpoint.writes ? endpoint.members->readers.size() : endpoint.members->writers.size());
}

void Network::publish(Endpoint& writer, std::span<const std::byte> bytes) {
  if (published) published(writer.process, writer.topic, bytes);
  scheduler_.note(writer.id);
  scheduler_.note(bytes.data(), bytes.size());
  ++writer.members->traffic.published;
  const Sample sample = std::make_shared<const Bytes>(bytes.begin(), bytes.end());
  push(writer.samples, sample, depth_of(writer.topic.profile).writer);
  if (faults.even) return send_evenly(writer, sample);
  for (const auto& [id, reader] : writer.members->readers) send(writer, *reader, sample);
}

void Network::send_evenly(Endpoint& writer, const Sample& sample) {
  std::vector<std::uint64_t> readers;
  for (const auto& [id, reader] : writer.members->readers)
    if (&writer.process == &reader->process)
      deliver(*writer.members, id, sample);
    else
      readers.push_back(id);
  writer.members->traffic.copies += readers.size();
  writer.members->traffic.bytes += readers.size() * sample->size();
  const Time arrival = (scheduler_.now() / faults.latency + 2) * faults.latency;
  scheduler_.at(arrival, [this, &members = *writer.members, readers = std::move(readers), sample] {
    for (const std::uint64_t id : readers) deliver(members, id, sample);
  });
}

/// Returns what a damaged sample may look like. Bytes that are wrong here and there are not among that: checksums of
/// the network find those, and no receiver could tell a wrong number from a right one.
Network::Sample Network::corrupt(const Bytes& sample) {
  Bytes bytes = sample;
  if (random_.below(2) == 0)
    bytes.resize(random_.below(sample.size()));
  else
    for (std::byte& byte : bytes) byte = static_cast<std::byte>(random_.below(256));
  return std::make_shared<const Bytes>(std::move(bytes));
}

void Network::send(Endpoint& writer, Endpoint& reader, Sample sample) {
  if (&writer.process == &reader.process) {
    deliver(*reader.members, reader.id, sample);
    return;
  }
  Traffic& traffic = reader.members->traffic;
  ++traffic.copies;
  traffic.bytes += sample->size();
  const bool lost = random_.uniform() < faults.loss;
  if (lost || cuts_.contains({writer.process.name(), reader.process.name()})) {
    ++(lost ? traffic.lost : traffic.cut);
    return;
  }
  if (faults.corruption > 0 && !sample->empty() && random_.uniform() < faults.corruption) {
    sample = corrupt(*sample);
    ++traffic.corrupt;
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
    scheduler_.at(arrival,
                  [this, &members = *reader.members, id = reader.id, sample] { deliver(members, id, sample); });
  }
}

void Network::deliver(Members& topic, std::uint64_t id, const Sample& sample) {
  const auto found = topic.readers.find(id);
  if (found == topic.readers.end()) return;  // it has gone meanwhile
  Endpoint& reader = *found->second;
  push(reader.samples, sample, depth_of(reader.topic.profile).reader);
  reader.raised = true;
  ++topic.traffic.delivered;
  if (arrived) arrived(reader.process, reader.topic, *sample);
  reader.process.wake();
}

}  // namespace citylearn::simulation
