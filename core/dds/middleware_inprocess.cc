// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <deque>

#include "core/dds/middleware_internal.h"
#include "core/dds/wakeup.h"
#include "core/util/error.h"

namespace citylearn::internal {
namespace {

using Sample = std::shared_ptr<const Bytes>;

/// One reader's samples (filled by its writers), or one writer's last samples (kept for readers that come later).
/// Guarded by the bus's mutex.
struct Endpoint {
  Topic topic;
  std::string participant;
  Wakeup::Flag* flag = nullptr;  // a reader's
  std::uint64_t id = 0;          // set by the bus
  std::deque<Sample> samples = {};
};

void push(std::deque<Sample>& samples, const Sample& sample, int depth) {
  samples.push_back(sample);
  if (samples.size() > static_cast<std::size_t>(depth)) samples.pop_front();
}

/// The state that the participants of one domain share. It exists while one of them does.
struct Bus {
  std::mutex mutex;
  std::vector<Endpoint*> readers;
  std::vector<Endpoint*> writers;
  std::atomic<std::uint64_t> endpoints{0};  // ever created

  void add(std::vector<Endpoint*>& list, Endpoint& endpoint) {
    list.push_back(&endpoint);
    endpoint.id = ++endpoints;
  }

  static std::shared_ptr<Bus> of(std::uint32_t domain) {
    static std::mutex all_mutex;
    static std::map<std::uint32_t, std::weak_ptr<Bus>> all;
    std::lock_guard lock(all_mutex);
    std::shared_ptr<Bus> bus = all[domain].lock();
    if (!bus) all[domain] = bus = std::make_shared<Bus>();
    return bus;
  }
};

bool match(const Topic& a, const Topic& b) { return a.name == b.name && a.type == b.type; }

int count_matches(const std::vector<Endpoint*>& endpoints, const Topic& topic) {
  return static_cast<int>(std::count_if(endpoints.begin(), endpoints.end(),
                                        [&](const Endpoint* endpoint) { return match(endpoint->topic, topic); }));
}

class InprocessPublisher : public Publisher {
 public:
  InprocessPublisher(std::shared_ptr<Bus> bus, const Topic& topic, const std::string& participant)
      : bus_(std::move(bus)), history_{topic, participant} {
    std::lock_guard lock(bus_->mutex);
    bus_->add(bus_->writers, history_);
  }
  ~InprocessPublisher() override {
    std::lock_guard lock(bus_->mutex);
    std::erase(bus_->writers, &history_);
  }
  void publish(std::span<const std::byte> bytes) override {
    check_size(history_.topic, bytes.size());
    const Sample sample = std::make_shared<const Bytes>(bytes.begin(), bytes.end());
    const Depth depth = depth_of(history_.topic.profile);
    std::lock_guard lock(bus_->mutex);
    push(history_.samples, sample, depth.writer);
    for (Endpoint* reader : bus_->readers) {
      if (!match(reader->topic, history_.topic)) continue;
      push(reader->samples, sample, depth.reader);
      reader->flag->raise();
    }
  }
  int matched() const override {
    std::lock_guard lock(bus_->mutex);
    return count_matches(bus_->readers, history_.topic);
  }

 private:
  const std::shared_ptr<Bus> bus_;
  Endpoint history_;
};

class InprocessSubscription : public Subscription {
 public:
  InprocessSubscription(std::shared_ptr<Bus> bus, const Topic& topic, const std::string& participant, Wakeup& wakeup)
      : bus_(std::move(bus)), flag_(wakeup), queue_{topic, participant, &flag_} {
    std::lock_guard lock(bus_->mutex);
    bus_->add(bus_->readers, queue_);
    for (const Endpoint* writer : bus_->writers)
      if (is_kept(topic.profile) && match(writer->topic, topic))
        for (const Sample& sample : writer->samples) push(queue_.samples, sample, depth_of(topic.profile).reader);
    if (!queue_.samples.empty()) flag_.raise();
  }
  ~InprocessSubscription() override {
    std::lock_guard lock(bus_->mutex);
    std::erase(bus_->readers, &queue_);
  }
  bool take(Bytes& sample) override {
    Sample first;
    {
      std::lock_guard lock(bus_->mutex);
      if (queue_.samples.empty()) {
        flag_.lower();
        return false;
      }
      first = std::move(queue_.samples.front());
      queue_.samples.pop_front();
    }
    sample.assign(first->begin(), first->end());
    return true;
  }
  int matched() const override {
    std::lock_guard lock(bus_->mutex);
    return count_matches(bus_->writers, queue_.topic);
  }

 private:
  const std::shared_ptr<Bus> bus_;
  Wakeup::Flag flag_;
  Endpoint queue_;
};

class InprocessMiddleware : public Middleware {
 public:
  InprocessMiddleware(std::uint32_t domain, std::string participant)
      : bus_(Bus::of(domain)), participant_(std::move(participant)) {}

  std::unique_ptr<Publisher> create_publisher(const Topic& topic) override {
    discovery_.register_local_topic(topic, true);
    return std::make_unique<InprocessPublisher>(bus_, topic, participant_);
  }
  std::unique_ptr<Subscription> create_subscription(const Topic& topic) override {
    discovery_.register_local_topic(topic, false);
    return std::make_unique<InprocessSubscription>(bus_, topic, participant_, wakeup_);
  }
  bool wait(Clock::time_point deadline) override { return wakeup_.wait(deadline); }
  DiscoveryMonitor& discovery() override {
    // No discovery here: look at what there is when something has come.
    if (const std::uint64_t now = bus_->endpoints; seen_ != now) {
      seen_ = now;
      std::lock_guard lock(bus_->mutex);
      for (const Endpoint* writer : bus_->writers) look(*writer, true);
      for (const Endpoint* reader : bus_->readers) look(*reader, false);
    }
    return discovery_;
  }
  std::string name() const override { return "inprocess"; }

 private:
  void look(const Endpoint& endpoint, bool writes) {
    discovery_.participant_found(endpoint.participant, {endpoint.participant, "inprocess", {}});
    discovery_.endpoint_found(std::to_string(endpoint.id), endpoint.participant, writes, endpoint.topic.name,
                              endpoint.topic.type);
  }

  const std::shared_ptr<Bus> bus_;
  const std::string participant_;
  Wakeup wakeup_;
  DiscoveryMonitor discovery_;
  std::uint64_t seen_ = 0;
};

}  // namespace

std::unique_ptr<Middleware> create_inprocess(std::uint32_t domain, const std::string& participant) {
  return std::make_unique<InprocessMiddleware>(domain, participant);
}

}  // namespace citylearn::internal
