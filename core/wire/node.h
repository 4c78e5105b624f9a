// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <set>
#include <string>

#include "core/dds/middleware.h"
#include "core/wire/messages.h"

namespace citylearn {

/// Counts of a node's traffic, as published in ServiceStatus.
struct Traffic {
  std::uint64_t received = 0;
  std::uint64_t repeated = 0;
  std::uint64_t resent = 0;
  std::uint64_t rejected = 0;
  std::uint64_t foreign = 0;
};

/// One service on the wire: its identity in a run, and typed writers and readers over one Middleware.
/// Used by one thread at a time.
class Node {
 public:
  struct Options {
    MiddlewareOptions middleware;
    std::string service;          ///< kind: "env_service"
    std::string id;               ///< unique within the run, at most 64 characters
    std::string run = "default";  ///< messages of other runs are ignored, at most 64 characters; empty: hears all runs
  };
  explicit Node(Options options);
  ~Node();

  template <class Message>
  void publish(Message& message) {  // stamps message.header()
    publish(message, options_.run);
  }

  /// The same, said in another run: for a node that hears all of them.
  template <class Message>
  void publish(Message& message, const std::string& run) {
    Channel& channel = publisher(topic_of<Message>());
    stamp(message.header(), run, ++channel.written);
    encode(message, buffer_);
    channel.publisher->publish(buffer_);
  }

  /// Publishes somebody else's message as it is, header and all.
  template <class Message>
  void forward(const Message& message) {
    encode(message, buffer_);
    publisher(topic_of<Message>()).publisher->publish(buffer_);
  }

  /// Next message of this run, not sent by this very process; false when there is none (`message` then holds anything).
  /// Undecodable ones are counted, logged once a kind, and skipped.
  template <class Message>
  bool take(Message& message) {
    Channel& channel = subscription(topic_of<Message>());
    while (channel.subscription->take(buffer_)) {
      try {
        decode(std::span<const std::byte>(buffer_), message);
      } catch (const Error& error) {
        reject(error);
        continue;
      }
      if (!accept(message.header())) continue;
      ++traffic.received;
      return true;
    }
    return false;
  }

  /// Creates the writer or reader ahead of its first use, so that discovery begins now.
  template <class Message>
  void announce() {
    publisher(topic_of<Message>());
  }
  template <class Message>
  void listen() {
    subscription(topic_of<Message>());
  }
  /// Ends what listen() or take() began; they may begin it again.
  template <class Message>
  void ignore() {
    if (const auto channel = channels_.find(&topic_of<Message>()); channel != channels_.end())
      channel->second.subscription.reset();
  }
  template <class Message>
  int readers() {
    return publisher(topic_of<Message>()).publisher->matched();
  }

  /// Waits until something may be there to take (true) or the deadline has passed. Publishes the heartbeat when it is
  /// due, and logs the middleware's faults.
  bool wait(Clock::time_point deadline);

  /// Publishes the heartbeat when it is due: for who waits elsewhere.
  void beat() {
    if (Clock::now() >= next_heartbeat_) heartbeat();
  }
  Clock::time_point next_beat() const { return next_heartbeat_; }

  /// What the next heartbeats say. A changed state is sent at once.
  void report(msg::State state, const std::string& activity, float rate = 0);

  /// Says in every heartbeat, and once in the log, that `what` ("checkpoint") is in trouble until somebody mends it
  /// ("the disk is full; the one before is kept"). Without a trouble: that it is no more.
  void alarm(const std::string& what, const std::string& trouble);

  const Options& options() const { return options_; }
  /// The others in the domain.
  Surroundings& surroundings() { return middleware_->surroundings(); }
  std::uint64_t incarnation() const { return incarnation_; }
  std::string middleware_name() const { return middleware_->name(); }
  /// Faults of the middleware seen so far (type mismatches), a line each.
  const std::vector<std::string>& faults() const { return faults_; }

  Traffic traffic;

 private:
  struct Channel {
    std::unique_ptr<Publisher> publisher;
    std::unique_ptr<Subscription> subscription;
    std::uint64_t written = 0;
  };
  Channel& publisher(const Topic& topic);
  Channel& subscription(const Topic& topic);
  void stamp(msg::Header& header, const std::string& run, std::uint64_t number) const;
  bool accept(const msg::Header& header);
  void reject(const Error& error);
  void heartbeat();

  Options options_;
  std::uint64_t incarnation_;
  std::unique_ptr<Middleware> middleware_;
  std::map<const Topic*, Channel> channels_;
  Bytes buffer_;
  msg::ServiceStatus status_;
  Clock::time_point started_, next_heartbeat_;
  std::vector<std::string> faults_;
  std::map<std::string, std::string> alarms_;
  std::set<std::string> rejected_;  // kinds logged: type and field
};

}  // namespace citylearn
