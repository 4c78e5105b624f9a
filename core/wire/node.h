// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "core/wire/messages.h"
#include "core/wire/node_options.h"

namespace citylearn {

/// One service on the wire: its identity in a session, and typed writers and readers over one Middleware.
/// Used by one thread at a time.
class Node {
 public:
  using Options = NodeOptions;
  explicit Node(Options options);
  ~Node();

  /// Publishes in this node's session, or in the one given, for a node that hears all of them.
  template <class Message>
  void publish(Message& message, const std::string& session = "") {
    Channel& channel = publisher(topic_of<Message>());
    stamp(message.header(), session, ++channel.written);
    encode(message, buffer_);
    channel.publisher->publish(buffer_);
  }
  /// Publishes another sender's message as it is, header and all.
  template <class Message>
  void forward(const Message& message) {
    encode(message, buffer_);
    publisher(topic_of<Message>()).publisher->publish(buffer_);
  }

  /// Takes the next message of this session that this process did not send; false when there is none. Skips messages
  /// that cannot be decoded; they are counted, and logged once a kind.
  template <class Message>
  bool take(Message& message) {
    Channel& channel = subscription(topic_of<Message>());
    while (channel.subscription->take(buffer_)) {
      try {
        decode(std::span<const std::byte>(buffer_), message);
        if (accept(message.header())) return true;
      } catch (const Error& error) {
        reject(error);
      }
    }
    return false;
  }

  /// Creates the writer or reader ahead of its first use, so that discovery begins now.
  template <class Message>
  void create_writer() {
    publisher(topic_of<Message>());
  }
  template <class Message>
  void create_reader() {
    subscription(topic_of<Message>());
  }
  /// Deletes the reader; create_reader() or take() may create it again.
  template <class Message>
  void delete_reader() {
    if (const auto channel = channels_.find(&topic_of<Message>()); channel != channels_.end())
      channel->second.subscription.reset();
  }
  template <class Message>
  int readers() {
    return publisher(topic_of<Message>()).publisher->matched();
  }

  /// Waits until there may be something to take (true) or the deadline has passed. Publishes due heartbeats and logs
  /// the middleware's faults.
  bool wait(Clock::time_point deadline);
  /// Publishes a heartbeat when it is due. Returns when the next one is.
  Clock::time_point publish_heartbeat_if_due();
  /// Sets what the next heartbeats say. A changed state is published at once.
  void report(msg::State state, const std::string& activity, float rate = 0);
  /// Reports in every heartbeat, and once in the log, that `what` ("checkpoint") has a problem ("the disk is full; the
  /// one before is kept"), until called with an empty `problem`.
  void alarm(const std::string& what, const std::string& problem);
  /// Throws Error when another process with this id was there first. Alarms when this one was, or is at work.
  void check_twin(const msg::ServiceStatus& status);
  const Options& options() const { return options_; }
  DiscoveryMonitor& discovery() { return middleware_->discovery(); }
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
  void stamp(msg::Header& header, const std::string& session, std::uint64_t number) const;
  bool accept(const msg::Header& header);
  void reject(const Error& error);
  void heartbeat();
  Options options_;
  std::uint64_t incarnation_;
  std::unique_ptr<Middleware> middleware_;
  std::map<const Topic*, Channel> channels_;
  Bytes buffer_;
  msg::ServiceStatus status_;
  Clock::time_point started_, next_heartbeat_, twin_heard_;
  std::vector<std::string> faults_;
  std::map<std::string, std::string> alarms_;
  std::set<std::string> rejected_;  // kinds logged: type and field
};

}  // namespace citylearn
