// SPDX-License-Identifier: Apache-2.0
#include "tools/record/recording.h"

#include <filesystem>
#include <set>

#include "core/exchange/timing.h"
#include "core/recording/idl_text.h"
#include "core/util/error.h"
#include "core/util/wall_clock.h"
#include "core/wire/messages.h"

namespace citylearn {
namespace {

constexpr std::uint64_t kFlushInterval = 1'000'000'000;  // nanoseconds
constexpr int kMaxMessagesPerTopic = 256;                // of a topic, before the others

std::string name_of(Profile profile) {
  switch (profile) {
    case Profile::kState:
      return "state";
    case Profile::kCommand:
      return "command";
    case Profile::kDurable:
      return "durable";
    case Profile::kRos2:
    case Profile::kRos2Reliable:
      break;  // not recorded
  }
  return "";
}

}  // namespace

Recording::Recording(Middleware& middleware, const RecordingOptions& options)
    : middleware_(middleware), options_(options) {
  std::set<std::string> wanted;
  for (const std::string& given : options_.topics)
    wanted.insert(given.starts_with("citylearn/") ? given : "citylearn/" + given);
  for (const Topic& topic : all_topics())
    if (options_.topics.empty() || wanted.erase(topic.name) > 0) topics_[topic.name] = topic;
  if (!wanted.empty()) throw Error("unknown topic", "--topics " + *wanted.begin(), "idl/ lists them");
  begin_file();
  for (const auto& [name, topic] : topics_) sources_[name] = {&topic, middleware.create_subscription(topic)};
}

/// Subscribes to the topics of single services that were discovered. Most have a reader before they have a writer, so
/// that little of what is sent first is missed.
void Recording::find_topics() {
  const std::string other = topic_at({"citylearn/", "", Profile::kState, 0}, options_.session, "").name;
  const std::string session = options_.session.empty() ? "" : other.substr(0, other.size() - 1);
  for (const DiscoveryMonitor::Endpoint& endpoint : middleware_.discovery().endpoints()) {
    if (sources_.contains(endpoint.topic) || !endpoint.topic.starts_with(session)) continue;
    const auto known = topics_.find(base_topic(endpoint.topic));
    // What is sent to all as well is recorded there.
    if (known == topics_.end() || known->second.type != endpoint.type ||
        addressing_of(known->second) == Addressing::kSenderAndAll)
      continue;
    Topic topic = known->second;
    topic.name = endpoint.topic;
    sources_[topic.name] = {&known->second, middleware_.create_subscription(topic)};
  }
}

void Recording::begin_file() {
  std::filesystem::path path = options_.output;
  if (!files_.empty())
    path.replace_filename(path.stem().string() + "-" + std::to_string(files_.size() + 1) + path.extension().string());
  McapWriter::Options options;
  options.library = options_.library;
  options.about = {{"session", options_.session}, {"part", std::to_string(files_.size() + 1)}};
  writer_ = std::make_unique<McapWriter>(path, options);
  files_.push_back(path);
  channels_.clear();
}

/// Counts messages that were missed: a writer keeps only some for a reader that is behind.
void Recording::follow(const std::string& name, const Source& source, const WireHeader& header) {
  if (source.topic->profile == Profile::kState) return;  // only the newest is promised
  const auto [newest, first] = newest_.try_emplace({name, header.sender, header.incarnation}, header.message);
  if (first || header.message <= newest->second) return;
  counts_[source.topic->name].missed += header.message - newest->second - 1;
  newest->second = header.message;
}

void Recording::write(const std::string& name, const Source& source) {
  // Messages without a readable header are kept, for those who read the file.
  const auto header = header_of(taken_);
  if (header) follow(name, source, *header);
  if (header && !options_.session.empty() && header->session != options_.session) {
    ++other_sessions_;
    return;
  }
  if (options_.split > 0 && writer_->bytes() >= options_.split) {
    writer_->close();
    begin_file();
  }
  const Topic& topic = *source.topic;
  std::uint16_t& channel = channels_[&topic];
  if (channel == 0)
    channel = writer_->add(
        {topic.name,
         topic.type,
         "omgidl",
         idl_of(topic.type),
         "cdr",
         {{"profile", name_of(topic.profile)}, {"type", topic.type}, {"protocol", std::to_string(msg::PROTOCOL)}}});
  writer_->write(channel, nanoseconds_since_epoch(), taken_);
  Count& count = counts_[topic.name];
  ++count.messages;
  count.bytes += taken_.size();
}

void Recording::poll() {
  if (const Clock::time_point now = Clock::now(); now >= next_look_) {
    find_topics();
    next_look_ = now + kTopicSearch;
  }
  bool more = true;
  while (more) {
    more = false;
    for (const auto& [name, source] : sources_) {
      int taken = 0;
      while (taken < kMaxMessagesPerTopic && source.subscription->take(taken_)) {
        write(name, source);
        ++taken;
      }
      more = more || taken == kMaxMessagesPerTopic;
    }
  }
  if (const std::uint64_t since = writer_->waiting_since();
      since != 0 && nanoseconds_since_epoch() - since >= kFlushInterval)
    writer_->flush();
}

void Recording::close() {
  poll();
  writer_->close();
}

}  // namespace citylearn
