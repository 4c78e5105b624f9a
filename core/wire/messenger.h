// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "core/wire/channels.h"
#include "core/wire/messages.h"
#include "core/wire/node_options.h"

namespace citylearn {

/// A service's identity in a session, and its typed writers and readers. The type of a message says on which topics it
/// goes out (Addressing). Used by one thread at a time.
class Messenger {
 public:
  /// Fills the header of a message and publishes it. `session`: for a node that hears all of them; empty: its own.
  template <class Message>
  void publish(Message& message, const std::string& session = "") {
    stamp(message.header(), session);
    const std::vector<Address> addresses = addresses_of(message);
    message.header().message(++channels_of<Message>().writer(addresses.front()).written);
    send(message, addresses);
  }
  /// Publishes another sender's message as it is, header and all.
  template <class Message>
  void forward(const Message& message) {
    send(message, addresses_of(message));
  }
  /// Takes the next message from this node's readers of the type. Returns false when there is none. Skips messages of
  /// this process and of other sessions, and those that cannot be decoded, which are counted and logged once a kind.
  template <class Message>
  bool take(Message& message) {
    while (channels_of<Message>().take(buffer_)) {
      traffic.received_bytes += buffer_.size();
      try {
        decode(std::span<const std::byte>(buffer_), message);
        if (accept(message.header())) return true;
      } catch (const Error& error) {
        reject(error);
      }
    }
    return false;
  }

  /// Creates the writers on the shared topic and on this service's own, if the type has them, so that discovery begins.
  template <class Message>
  void create_writer() {
    Channels& channels = channels_of<Message>();
    if (channels.addressing() != Addressing::kReceiver) channels.writer(own_address(channels.addressing()));
    if (channels.addressing() == Addressing::kSenderAndAll) channels.writer(at(options_.id));
  }
  /// Creates the writer on the topic of service `id`, which is kept until release_topics().
  template <class Message>
  void create_writer_at(const std::string& id) {
    channels_of<Message>().writer(at(id)).kept = true;
  }
  /// Creates the reader on the shared topic, or on this service's own topic where messages name a receiver.
  template <class Message>
  void create_reader() {
    create_reader_at<Message>(addressing_of<Message>() == Addressing::kReceiver ? options_.id : "");
  }
  /// Create and delete the reader on the topic of service `id` of `session`, or on the shared one if `id` is empty.
  template <class Message>
  void create_reader_at(const std::string& id, const std::string& session = "") {
    channels_of<Message>().create_reader(session.empty() ? at(id) : Address{session, id});
  }
  template <class Message>
  void delete_reader_at(const std::string& id) {
    channels_of<Message>().delete_reader(at(id));
  }
  /// Deletes the writers and readers on the topics of service `id`.
  void release_topics(const std::string& id);
  /// Returns how many readers match this service's writer on the shared topic, or on its own topic.
  template <class Message>
  int readers() {
    return channels_of<Message>().writer(own_address(addressing_of<Message>())).publisher->matched();
  }

  std::uint64_t incarnation() const { return incarnation_; }
  Traffic traffic;

 protected:
  /// Throws Error when the options are invalid.
  explicit Messenger(const NodeOptions& options);
  ~Messenger();
  void delete_idle_writers(Clock::time_point now);

  const NodeOptions options_;
  const std::uint64_t incarnation_;
  const std::unique_ptr<Middleware> middleware_;

 private:
  template <class Message>
  Channels& channels_of() {
    const Topic& shared = topic_of<Message>();
    return channels_.try_emplace(&shared, *middleware_, shared, addressing_of<Message>()).first->second;
  }
  template <class Message>
  void send(const Message& message, const std::vector<Address>& addresses) {
    encode(message, buffer_);
    for (const Address& address : addresses) channels_of<Message>().writer(address).publisher->publish(buffer_);
    traffic.sent_bytes += addresses.size() * buffer_.size();
  }
  /// Returns the address of a service of this session, or the shared one for an empty id.
  Address at(const std::string& id) const { return id.empty() ? Address() : Address{options_.session, id}; }
  Address own_address(Addressing addressing) const { return at(addressing == Addressing::kSender ? options_.id : ""); }
  void stamp(msg::Header& header, const std::string& session) const;
  bool accept(const msg::Header& header);
  void reject(const Error& error);

  std::map<const Topic*, Channels> channels_;  ///< by shared topic
  Bytes buffer_;
  std::set<std::string> rejected_;  ///< kinds logged: type and field
};

}  // namespace citylearn
