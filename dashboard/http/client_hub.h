// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>

#include "core/dds/middleware.h"
#include "dashboard/http/hub.h"

namespace citylearn {

/// The Hub of a server: one bounded queue per client. A message is kept once, however many clients wait for it;
/// publishing only puts pointers into queues. States (kReplace) are kept by topic, so that no bound can drop the
/// newest.
class ClientHub : public Hub {
  struct Message;

 public:
  struct Options {
    std::size_t rows = 2000;       ///< of one kAppend topic that wait for one client
    std::size_t each = 256;        ///< messages of one kEach topic that wait for one client
    std::size_t bytes = 16 << 20;  ///< payload of kAppend and kEach that waits for one client, all topics
    /// A topic with a message counts as watched for so long after its last watcher left: a reloaded page gets the state
    /// at once, and publishers that poll watched() see no gap.
    std::chrono::milliseconds linger{2000};
  };
  /// The contents of one WebSocket frame: `head` (length, JSON, padding to 8 bytes), then `payload`.
  struct Frame {
    std::string head;
    std::shared_ptr<const std::vector<std::byte>> payload;
  };
  struct Counts {
    std::size_t clients = 0;
    std::uint64_t published = 0;  ///< messages of watched topics
    std::uint64_t taken = 0;      ///< frames, all clients
    std::uint64_t dropped = 0;    ///< messages (of kAppend: rows), all clients
  };

  /// One client's queue. May be used by any thread. Leaves the hub when it is destroyed; the hub must outlive it.
  class Client {
   public:
    ~Client();
    Client(const Client&) = delete;
    Client& operator=(const Client&) = delete;
    /// Replaces the watched topics. Drops what waits of other topics. Of a new kReplace topic that another client
    /// watches already, the newest message waits at once.
    void watch(const std::set<std::string>& topics);
    /// Returns the next frame, the oldest topic first. Once it has returned nothing, `wake` is called at the next
    /// message.
    std::optional<Frame> next();

   private:
    friend class ClientHub;
    Client(ClientHub& hub, std::function<void()> wake) : hub_(hub), wake_(std::move(wake)) {}
    ClientHub& hub_;
    const std::function<void()> wake_;
    /// Messages of one topic that the client has not taken. kReplace: the newest one; kEach: one message a frame;
    /// kAppend: all messages in one frame.
    struct Waiting {
      std::deque<std::shared_ptr<const Message>> messages;  // empty for kReplace
      std::size_t rows = 0;                                 // of all messages, less `skipped`
      std::size_t skipped = 0;                              // rows of the first message that are lost already
    };
    // All below under the hub's lock.
    std::map<std::string, Waiting> waiting_;  // by topic
    std::deque<std::string> order_;           // topics that wait, each once
    std::set<std::string> topics_;
    std::size_t bytes_ = 0;
    std::uint64_t dropped_ = 0;
    bool asleep_ = true;
  };

  ClientHub() : ClientHub(Options()) {}
  explicit ClientHub(const Options& options) : options_(options) {}

  /// Adds a client that watches nothing yet. The publishing thread calls `wake` under the hub's lock: it must return at
  /// once and not call the hub.
  std::shared_ptr<Client> join(std::function<void()> wake);

  /// A kAppend message has "rows" (at least 1) and a payload of equally long rows. A topic is always merged in the same
  /// way. Otherwise throws Error.
  void publish(const std::string& topic, nlohmann::json header, std::vector<std::byte> payload, Merge merge) override;
  std::vector<std::string> watched() const override;
  Counts counts() const;

 private:
  struct Topic {
    std::set<Client*> watchers;
    std::uint64_t sequence = 0;             // of its messages, from when it began to be watched
    std::shared_ptr<const Message> newest;  // none before the first
    Clock::time_point left;                 // by its last watcher
  };
  void enqueue(Client& client, const std::string& topic, const std::shared_ptr<const Message>& message);
  void make_room(Client& client, const std::string& newest);
  void drop_first(Client& client, const std::string& topic);
  void lose(Client& client, std::uint64_t count);
  void forget(Client& client, const std::string& topic);
  void leave(Client& client, const std::string& topic);
  void forget_topics() const;

  const Options options_;
  mutable std::mutex lock_;
  mutable std::map<std::string, Topic> topics_;
  mutable std::size_t lingering_ = 0;  // topics without watchers
  Counts counts_;
};

}  // namespace citylearn
