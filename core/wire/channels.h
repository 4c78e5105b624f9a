// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>

#include "core/wire/messages.h"

namespace citylearn {

/// The writers and readers of one message type, on the shared topic and on the topics of single services. A writer to a
/// receiver is deleted when it was not used for some seconds, because any program may ask for something under any name.
/// Used by one thread at a time. Must not outlive the middleware.
class Channels {
 public:
  Channels(Middleware& middleware, const Topic& all, Addressing addressing)
      : middleware_(&middleware), all_(&all), addressing_(addressing) {}

  struct Writer {
    std::unique_ptr<Publisher> publisher;
    std::uint64_t written = 0;  ///< messages, for Header.message
    Clock::time_point used = {};
    bool kept = false;  ///< however long it is not used
  };
  /// Returns the writer of a topic, which it creates at its first use.
  Writer& writer(const Address& address);
  void delete_idle_writers(Clock::time_point now);
  void wait_for_acknowledgments(Clock::time_point deadline);

  void create_reader(const Address& address);
  void delete_reader(const Address& address);
  /// Takes a sample from the readers in turn, so that a busy one does not delay the others. Returns false without any.
  bool take(Bytes& sample);

  /// Deletes the writer and the reader of a topic.
  void release_topics(const Address& address);
  Addressing addressing() const { return addressing_; }

 private:
  Topic topic(const Address& address) const;

  Middleware* middleware_;
  const Topic* all_;
  Addressing addressing_;
  std::map<Address, Writer> writers_;
  std::map<Address, std::unique_ptr<Subscription>> readers_;
  Address last_;  // of the reader that had something last
};

}  // namespace citylearn
