// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "core/recording/idl_text.h"
#include "core/recording/mcap_writer.h"
#include "core/wire/messages.h"

namespace citylearn::testing {

/// Writes messages as a recording of them has them.
class Tape {
 public:
  explicit Tape(const std::string& path, const McapWriter::Options& options = {"test", {}}) : writer(path, options) {}
  ~Tape() { writer.close(); }

  template <class Message>
  void say(const Message& message, std::uint64_t time) {
    const Topic& topic = topic_of<Message>();
    std::uint16_t& channel = channels_[topic.name];
    if (channel == 0) channel = writer.add({topic.name, topic.type, "omgidl", idl_of(topic.type), "cdr", {}});
    Bytes bytes;
    encode(message, bytes);
    writer.write(channel, time, bytes);
  }
  McapWriter writer;

 private:
  std::map<std::string, std::uint16_t> channels_;
};

struct Heard {
  std::string topic;
  std::uint64_t time;
  Bytes bytes;
};

/// Returns all messages of a file, and what it lacks.
inline std::vector<Heard> all_of(const std::string& path, std::string* missing = nullptr) {
  McapReader reader(path);
  std::vector<Heard> all;
  while (const auto message = reader.next())
    all.push_back({message->channel->topic, message->log_time, Bytes(message->data.begin(), message->data.end())});
  if (missing) *missing = reader.missing();
  return all;
}

}  // namespace citylearn::testing
