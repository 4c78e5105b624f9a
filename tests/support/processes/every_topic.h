// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>

#include "core/wire/messages.h"

namespace citylearn::testing {

/// Hears what is sent on any topic, those of single services too, and sends bytes on any.
class EveryTopic {
 public:
  explicit EveryTopic(Middleware& middleware) : middleware_(middleware) {
    for (const Topic& topic : all_topics()) {
      kinds_[topic.name] = topic;
      readers_[topic.name] = middleware_.create_subscription(topic);
    }
  }

  /// Subscribes to what was discovered since, and calls `heard(base, bytes)` for each message that came; `base` is the
  /// topic of all of its type.
  template <class Heard>
  void take(Heard heard) {
    for (const DiscoveryMonitor::Endpoint& endpoint : middleware_.discovery().endpoints())
      if (const auto kind = kinds_.find(base_topic(endpoint.topic));
          kind != kinds_.end() && !readers_.contains(endpoint.topic))
        readers_[endpoint.topic] = middleware_.create_subscription(named(kind->second, endpoint.topic));
    for (const auto& [name, reader] : readers_)
      while (reader->take(taken_)) heard(kinds_.at(base_topic(name)), taken_);
  }
  void send(const Topic& topic, const Bytes& bytes) {
    std::unique_ptr<Publisher>& writer = writers_[topic.name];
    if (!writer) writer = middleware_.create_publisher(topic);
    writer->publish(bytes);
  }

 private:
  static Topic named(Topic topic, const std::string& name) {
    topic.name = name;
    return topic;
  }

  Middleware& middleware_;
  std::map<std::string, Topic> kinds_;  // those of all, by name
  std::map<std::string, std::unique_ptr<Subscription>> readers_;
  std::map<std::string, std::unique_ptr<Publisher>> writers_;
  Bytes taken_;
};

}  // namespace citylearn::testing
